#include "weak_memory.h"

#include <algorithm>
#include <array>
#include <tuple>

#include "machine.h"

namespace weak_memory
{

bool Site::operator<(const Site& other) const
{
  return std::tie(function, line, operation, order) <
         std::tie(other.function, other.line, other.operation, other.order);
}

const char* nameOf(std::memory_order order)
{
  switch (order)
  {
    case std::memory_order_relaxed:
      return "relaxed";
    case std::memory_order_acquire:
      return "acquire";
    case std::memory_order_release:
      return "release";
    case std::memory_order_acq_rel:
      return "acq_rel";
    default:
      return "seq_cst";
  }
}

std::string Site::toString() const
{
  return function + ": " + operation + " " + nameOf(order);
}

std::string Mutation::toString() const
{
  return site.toString() + " -> " + nameOf(order);
}

std::vector<std::memory_order> weakerThan(const Site& site)
{
  const bool load = site.operation.find(".load") != std::string::npos;
  const bool store = site.operation.find(".store") != std::string::npos;
  switch (site.order)
  {
    case std::memory_order_seq_cst:
      return {load ? std::memory_order_acquire : store ? std::memory_order_release : std::memory_order_acq_rel};
    case std::memory_order_acq_rel:
      return {std::memory_order_acquire, std::memory_order_release};
    case std::memory_order_acquire:
    case std::memory_order_release:
      return {std::memory_order_relaxed};
    default:
      return {};
  }
}

Model::Model() : machine_(new Machine) {}

Model& Model::instance()
{
  static Model* model = new Model;
  return *model;
}

Model::Result Model::run(const Program& program, const Mutation* mutation)
{
  Machine& machine = *machine_;
  mutation_ = mutation;
  machine.trail.clear();
  machine.visited.clear();
  machine.known_sites.clear();
  machine.failure.clear();
  Result result;
  do
  {
    machine.execute(program);
    ++result.executions;
  } while (machine.failure.empty() && machine.nextExecution());
  result.states = machine.visited.size();
  result.failure = machine.failure;
  if (!result.failure.empty())
  {
    machine.replays = true;
    machine.execute(program);
    machine.replays = false;
    for (const std::string& line : machine.log)
    {
      result.failure += "\n" + line;
    }
  }
  mutation_ = nullptr;
  return result;
}

void Model::name(const void* address, const std::string& name)
{
  names_[address] = name;
}

std::string Model::nameOfLocation(const void* address) const
{
  const auto found = names_.find(address);
  return found != names_.end() ? found->second : "atomic";
}

void Model::require(bool condition, const std::string& what)
{
  if (!condition)
  {
    machine_->fail(what);
    if (machine_->concurrent)
    {
      machine_->yieldToScheduler();  // never comes back
    }
  }
}

std::memory_order Model::effective(const char* operation, const void* address, std::memory_order order,
                                   const char* function, int line)
{
  if (order == std::memory_order_relaxed)
  {
    return order;
  }
  const auto [entry, added] =
      machine_->known_sites.try_emplace(std::make_tuple(operation, function, line, order), Machine::KnownSite{});
  Machine::KnownSite& known = entry->second;
  if (added)
  {
    known.site = Site{std::string(function).substr(0, std::string(function).find('<')),
                      address != nullptr ? nameOfLocation(address) + "." + operation : operation, order, line};
    known.count = &sites_[known.site];
    known.mutated = mutation_ != nullptr && !(known.site < mutation_->site) && !(mutation_->site < known.site);
  }
  ++*known.count;
  return known.mutated ? mutation_->order : order;
}

void Model::note(const std::function<std::string()>& line)
{
  if (machine_->replays)
  {
    machine_->log.push_back("  thread " + std::to_string(machine_->running) + ": " + line());
  }
}

uint64_t Model::load(const void* address, uint64_t* raw, std::memory_order order, const char* function, int line)
{
  Machine& machine = *machine_;
  if (!machine.concurrent)
  {
    return *raw;
  }
  machine.yieldToScheduler();
  order = effective("load", address, order, function, line);
  const size_t id = machine.idOf(address, raw);
  const size_t lowest = machine.lowestPlace(id, order);
  // The newest first: the executions that look as expected are then the first ones.
  const size_t newest = machine.locations[id].messages.size() - 1;
  const size_t place = newest - machine.choose(static_cast<uint32_t>(newest - lowest + 1));
  machine.read(id, place, order);
  const uint64_t value = machine.locations[id].messages[place].value;
  machine.observe(value);
  note([&] { return std::string(function) + ": " + nameOfLocation(address) + " is " + std::to_string(value); });
  return value;
}

void Model::store(const void* address, uint64_t* raw, uint64_t value, std::memory_order order, const char* function,
                  int line)
{
  Machine& machine = *machine_;
  if (!machine.concurrent)
  {
    *raw = value;
    return;
  }
  machine.yieldToScheduler();
  order = effective("store", address, order, function, line);
  const size_t id = machine.idOf(address, raw);
  std::vector<Message>& messages = machine.locations[id].messages;
  std::array<size_t, 256> places;
  uint32_t count = 0;
  for (size_t place = messages.size(); place > machine.lowestPlace(id, order); --place)
  {
    if (!messages[place - 1].followed_by_its_change)
    {
      places[count++] = place;
    }
  }
  machine.write(id, places[machine.choose(count)], value, order, nullptr);
  machine.observe(0);
  note([&] { return std::string(function) + ": " + nameOfLocation(address) + " = " + std::to_string(value); });
}

uint64_t Model::readModifyWrite(const void* address, uint64_t* raw, const Change& change, bool may_fail_spuriously,
                                bool* changed, std::memory_order order, std::memory_order failure_order,
                                const char* operation, const char* function, int line)
{
  Machine& machine = *machine_;
  uint64_t next = 0;
  if (!machine.concurrent)
  {
    const uint64_t old = *raw;
    *changed = change(old, &next);
    *raw = *changed ? next : old;
    return old;
  }
  machine.yieldToScheduler();
  const std::memory_order given = order;
  order = effective(operation, address, order, function, line);
  if (order != given)
  {
    failure_order = acquires(order) ? std::memory_order_acquire : std::memory_order_relaxed;
  }
  const size_t id = machine.idOf(address, raw);
  std::vector<Message>& messages = machine.locations[id].messages;
  std::array<size_t, 256> places;
  uint32_t count = 0;
  for (size_t place = messages.size(); place-- > machine.lowestPlace(id, order);)
  {
    // What has been read by another change can only be seen by one that fails.
    if (!change(messages[place].value, &next) || !messages[place].followed_by_its_change)
    {
      places[count++] = place;
    }
  }
  const size_t place = places[machine.choose(count)];
  const uint64_t old = messages[place].value;
  *changed = change(old, &next);
  if (*changed && may_fail_spuriously && machine.spurious_failure_left && machine.choose(2) == 1)
  {
    machine.spurious_failure_left = false;
    *changed = false;
  }
  if (*changed)
  {
    machine.read(id, place, order);
    const View inherited = messages[place].view;
    messages[place].followed_by_its_change = true;
    machine.write(id, place + 1, next, order, &inherited);
  }
  else
  {
    machine.read(id, place, failure_order);
  }
  machine.observe(old * 2 + (*changed ? 1 : 0));
  note(
      [&]
      {
        return std::string(function) + ": " + nameOfLocation(address) + " " + operation + " " + std::to_string(old) +
               (*changed ? " -> " + std::to_string(next) : std::string(" fails"));
      });
  return old;
}

void Model::fence(std::memory_order order, const char* function, int line)
{
  Machine& machine = *machine_;
  if (!machine.concurrent)
  {
    return;
  }
  order = effective("fence", nullptr, order, function, line);
  require(order != std::memory_order_seq_cst, "the model knows no seq_cst fence");
  Machine::Thread& thread = machine.self();
  if (acquires(order))
  {
    thread.current.join(thread.after_acquire_fence);
  }
  if (releases(order))
  {
    thread.at_release_fence = thread.current;
  }
}

void Model::readPlain(const void* address)
{
  Machine& machine = *machine_;
  if (!machine.concurrent)
  {
    return;
  }
  PlainLocation& access = machine.plain[address];
  View& view = machine.self().current;
  require(
      access.writer == MAX_THREADS || access.writer == machine.running || access.written <= view.clock[access.writer],
      nameOfLocation(address) + " is read while it is written");
  access.read[machine.running] = ++view.clock[machine.running];
  note([&] { return "reads " + nameOfLocation(address); });
}

void Model::writePlain(const void* address)
{
  Machine& machine = *machine_;
  if (!machine.concurrent)
  {
    return;
  }
  PlainLocation& access = machine.plain[address];
  View& view = machine.self().current;
  require(
      access.writer == MAX_THREADS || access.writer == machine.running || access.written <= view.clock[access.writer],
      nameOfLocation(address) + " is written by two");
  for (size_t i = 0; i < MAX_THREADS; ++i)
  {
    require(i == machine.running || access.read[i] <= view.clock[i],
            nameOfLocation(address) + " is written while it is read");
  }
  access.writer = machine.running;
  access.written = ++view.clock[machine.running];
  note([&] { return "writes " + nameOfLocation(address); });
}

void Model::lock(const void* mutex)
{
  Machine& machine = *machine_;
  if (!machine.concurrent)
  {
    return;
  }
  machine.self().waits_for = [mutex] { return instance().machine_->mutexes[mutex].held == 0; };
  machine.yieldToScheduler();
  Machine::MutexState& state = machine.mutexes[mutex];
  state.held = 1;
  machine.self().current.join(state.view);
  machine.observe(1);
}

void Model::unlock(const void* mutex)
{
  Machine& machine = *machine_;
  if (machine.concurrent)
  {
    machine.mutexes[mutex] = Machine::MutexState{0, machine.self().current};
  }
}

void Model::ring(const void* bell)
{
  Machine& machine = *machine_;
  if (machine.concurrent)
  {
    machine.yieldToScheduler();
    machine.bells[bell] = 1;
    machine.observe(2);
    note([] { return "rings"; });
  }
}

void Model::awaitRing(const void* bell)
{
  Machine& machine = *machine_;
  if (machine.concurrent)
  {
    machine.self().waits_for = [bell] { return instance().machine_->bells[bell] != 0; };
    machine.yieldToScheduler();
    machine.bells[bell] = 0;
    machine.observe(3);
    note([] { return "wakes up"; });
  }
}

}  // namespace weak_memory
