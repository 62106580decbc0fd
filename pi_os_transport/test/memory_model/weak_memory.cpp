#include "weak_memory.h"

#include <ucontext.h>

#include <algorithm>
#include <array>
#include <memory>
#include <sstream>
#include <tuple>
#include <unordered_map>
#include <unordered_set>

namespace weak_memory
{
namespace
{

constexpr size_t MAX_LOCATIONS = 48;
constexpr size_t MAX_THREADS = 3;
constexpr size_t STACK_BYTES = 64 << 10;
constexpr uint64_t MOST_STEPS = 2000;  // of one execution; more is a loop that never ends

bool acquires(std::memory_order order)
{
  return order == std::memory_order_acquire || order == std::memory_order_acq_rel || order == std::memory_order_seq_cst;
}

bool releases(std::memory_order order)
{
  return order == std::memory_order_release || order == std::memory_order_acq_rel || order == std::memory_order_seq_cst;
}

uint64_t mix(uint64_t value)
{
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9;
  value = (value ^ (value >> 27)) * 0x94d049bb133111eb;
  return value ^ (value >> 31);
}

/// What a thread, or who reads a message, knows: the place in each location's modification order that it may not look
/// behind, and how many plain accesses of each thread happened before.
struct View
{
  std::array<uint8_t, MAX_LOCATIONS> place{};
  std::array<uint8_t, MAX_THREADS> clock{};

  void join(const View& other)
  {
    for (size_t i = 0; i < MAX_LOCATIONS; ++i)
    {
      place[i] = std::max(place[i], other.place[i]);
    }
    for (size_t i = 0; i < MAX_THREADS; ++i)
    {
      clock[i] = std::max(clock[i], other.clock[i]);
    }
  }
};

struct Message
{
  uint64_t value = 0;
  View view;
  bool followed_by_its_change = false;  ///< a read-modify-write has read it: nothing may come between
};

struct Location
{
  const void* address = nullptr;
  uint64_t* raw = nullptr;
  std::vector<Message> messages;
  uint8_t sequential = 0;  ///< what seq_cst operations have seen or written
};

struct PlainLocation
{
  size_t writer = MAX_THREADS;
  uint8_t written = 0;
  std::array<uint8_t, MAX_THREADS> read{};
};

struct Choice
{
  uint32_t taken;
  uint32_t of;
};

}  // namespace

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

struct Model::Machine
{
  struct Thread
  {
    ucontext_t context;
    std::vector<char> stack = std::vector<char>(STACK_BYTES);
    Body body;
    View current;
    View after_acquire_fence;
    View at_release_fence;
    bool finished = false;
    std::function<bool()> waits_for;
    uint64_t history = 0;  ///< hash of all values it has seen: with the code it tells where it is
  };

  bool concurrent = false;
  ucontext_t scheduler;
  std::vector<std::unique_ptr<Thread>> threads;
  size_t running = 0;
  std::vector<Location> locations;
  std::unordered_map<const void*, size_t> location_ids;
  std::map<const void*, PlainLocation> plain;
  struct MutexState
  {
    uint8_t held = 0;
    View view;
  };
  std::map<const void*, MutexState> mutexes;
  std::map<const void*, uint8_t> bells;
  std::vector<Choice> trail;
  size_t depth = 0;
  uint64_t steps = 0;
  bool spurious_failure_left = false;
  std::unordered_set<uint64_t> visited;
  std::string failure;
  bool replays = false;  ///< a failure is executed once more, to tell what led there
  std::vector<std::string> log;
  struct KnownSite
  {
    Site site;
    uint64_t* count;
    bool mutated;
  };
  std::map<std::tuple<const char*, const char*, int, std::memory_order>, KnownSite> known_sites;

  Thread& self() { return *threads[running]; }

  uint32_t choose(uint32_t of)
  {
    if (of <= 1)
    {
      return 0;
    }
    if (depth == trail.size())
    {
      trail.push_back(Choice{0, of});
    }
    return trail[depth++].taken;
  }

  /// Moves on to the next leaf. False if all have been seen.
  bool nextExecution()
  {
    while (!trail.empty() && trail.back().taken + 1 == trail.back().of)
    {
      trail.pop_back();
    }
    if (trail.empty())
    {
      return false;
    }
    ++trail.back().taken;
    return true;
  }

  size_t idOf(const void* address, uint64_t* raw)
  {
    const auto [entry, added] = location_ids.emplace(address, locations.size());
    if (added)
    {
      if (locations.size() == MAX_LOCATIONS)
      {
        fail("more than MAX_LOCATIONS locations");
        return 0;
      }
      locations.push_back(Location{address, raw, {Message{*raw, View{}, false}}, 0});
    }
    return entry->second;
  }

  void fail(const std::string& what)
  {
    if (failure.empty())
    {
      failure = what;
    }
  }

  void yieldToScheduler() { swapcontext(&self().context, &scheduler); }

  void observe(uint64_t value) { self().history = mix(self().history * 31 + value + 1); }

  /// Inserts a message at `place`, and moves what every view says about later ones.
  void insert(size_t id, size_t place, Message message)
  {
    const auto shift = [id, place](View* view)
    {
      if (view->place[id] >= place)
      {
        ++view->place[id];
      }
    };
    Location& location = locations[id];
    if (place < location.messages.size())
    {
      for (Location& other : locations)
      {
        for (Message& one : other.messages)
        {
          shift(&one.view);
        }
      }
      for (const std::unique_ptr<Thread>& thread : threads)
      {
        shift(&thread->current);
        shift(&thread->after_acquire_fence);
        shift(&thread->at_release_fence);
      }
      for (auto& [mutex, state] : mutexes)
      {
        shift(&state.view);
      }
      if (location.sequential >= place)
      {
        ++location.sequential;
      }
    }
    location.messages.insert(location.messages.begin() + static_cast<std::ptrdiff_t>(place), std::move(message));
  }

  View viewOfStore(std::memory_order order) { return releases(order) ? self().current : self().at_release_fence; }

  void write(size_t id, size_t place, uint64_t value, std::memory_order order, const View* inherited)
  {
    insert(id, place, Message{value, View{}, false});
    Thread& thread = self();
    thread.current.place[id] = static_cast<uint8_t>(place);
    thread.after_acquire_fence.place[id] = std::max(thread.after_acquire_fence.place[id], static_cast<uint8_t>(place));
    View view = viewOfStore(order);
    view.place[id] = static_cast<uint8_t>(place);
    if (inherited != nullptr)
    {
      view.join(*inherited);
    }
    locations[id].messages[place].view = view;
    if (order == std::memory_order_seq_cst)
    {
      locations[id].sequential = std::max(locations[id].sequential, static_cast<uint8_t>(place));
    }
  }

  void read(size_t id, size_t place, std::memory_order order)
  {
    Thread& thread = self();
    const View view = locations[id].messages[place].view;
    thread.current.place[id] = std::max(thread.current.place[id], static_cast<uint8_t>(place));
    thread.after_acquire_fence.place[id] = std::max(thread.after_acquire_fence.place[id], static_cast<uint8_t>(place));
    thread.after_acquire_fence.join(view);
    if (acquires(order))
    {
      thread.current.join(view);
    }
    if (order == std::memory_order_seq_cst)
    {
      locations[id].sequential = std::max(locations[id].sequential, static_cast<uint8_t>(place));
    }
  }

  size_t lowestPlace(size_t id, std::memory_order order)
  {
    const size_t known = self().current.place[id];
    return order == std::memory_order_seq_cst ? std::max<size_t>(known, locations[id].sequential) : known;
  }

  uint64_t hashOf(const View& view) const
  {
    uint64_t hash = 0;
    for (size_t i = 0; i < locations.size(); ++i)
    {
      hash += view.place[i] == 0 ? 0 : mix(reinterpret_cast<uintptr_t>(locations[i].address) * 257 + view.place[i]);
    }
    for (size_t i = 0; i < MAX_THREADS; ++i)
    {
      hash = mix(hash + view.clock[i]);
    }
    return hash;
  }

  /// Does not depend on the order in which locations were touched first.
  uint64_t hashOfState() const
  {
    uint64_t hash = spurious_failure_left ? 1 : 0;
    for (const std::unique_ptr<Thread>& thread : threads)
    {
      hash = mix(hash * 3 + thread->history);
      hash = mix(hash * 3 + (thread->finished ? 1 : 0));
      hash = mix(hash * 3 + hashOf(thread->current));
      hash = mix(hash * 3 + hashOf(thread->after_acquire_fence));
      hash = mix(hash * 3 + hashOf(thread->at_release_fence));
    }
    uint64_t sum = 0;
    for (const Location& location : locations)
    {
      if (location.messages.size() == 1 && location.sequential == 0)
      {
        continue;  // as if never touched
      }
      uint64_t part = mix(reinterpret_cast<uintptr_t>(location.address) + location.sequential);
      for (const Message& message : location.messages)
      {
        part = mix(part * 5 + message.value);
        part = mix(part * 5 + hashOf(message.view) + (message.followed_by_its_change ? 1 : 0));
      }
      sum += part;
    }
    for (const auto& [address, access] : plain)
    {
      uint64_t part = mix(reinterpret_cast<uintptr_t>(address) + access.writer * 1000 + access.written);
      for (const uint8_t clock : access.read)
      {
        part = mix(part * 5 + clock);
      }
      sum += part;
    }
    for (const auto& [mutex, state] : mutexes)
    {
      sum += mix(reinterpret_cast<uintptr_t>(mutex) + hashOf(state.view) + state.held);
    }
    for (const auto& [bell, rung] : bells)
    {
      sum += rung == 0 ? 0 : mix(reinterpret_cast<uintptr_t>(bell));
    }
    return mix(hash + sum);
  }

  static void enter();
  void execute(const Program& program);
};

namespace
{
Model::Body* entering_body = nullptr;
}

void Model::Machine::enter()
{
  Machine& machine = *instance().machine_;
  Body& body = *entering_body;
  body();
  machine.self().finished = true;
  for (;;)
  {
    machine.yieldToScheduler();
  }
}

void Model::Machine::execute(const Program& program)
{
  locations.clear();
  location_ids.clear();
  plain.clear();
  mutexes.clear();
  bells.clear();
  depth = 0;
  steps = 0;
  spurious_failure_left = true;
  log.clear();
  concurrent = false;
  program.prepare();
  threads.resize(program.threads.size());
  for (size_t i = 0; i < threads.size(); ++i)
  {
    if (!threads[i])
    {
      threads[i] = std::make_unique<Thread>();
    }
    Thread& thread = *threads[i];
    thread.body = program.threads[i];
    thread.current = thread.after_acquire_fence = thread.at_release_fence = View{};
    thread.finished = false;
    thread.waits_for = nullptr;
    thread.history = 0;
    getcontext(&thread.context);
    thread.context.uc_stack.ss_sp = thread.stack.data();
    thread.context.uc_stack.ss_size = thread.stack.size();
    thread.context.uc_link = nullptr;
    makecontext(&thread.context, &Machine::enter, 0);
  }
  concurrent = true;
  while (failure.empty())
  {
    std::array<size_t, MAX_THREADS> ready{};
    uint32_t count = 0;
    bool all_finished = true;
    for (size_t i = 0; i < threads.size(); ++i)
    {
      all_finished = all_finished && threads[i]->finished;
      if (!threads[i]->finished && (!threads[i]->waits_for || threads[i]->waits_for()))
      {
        ready[count++] = i;
      }
    }
    if (all_finished)
    {
      break;
    }
    if (count == 0)
    {
      fail("a thread waits for ever");
      break;
    }
    if (++steps > MOST_STEPS)
    {
      fail("an execution without end");
      break;
    }
    if (!replays && depth == trail.size() && !visited.insert(hashOfState()).second)
    {
      concurrent = false;
      return;  // what follows from here has been seen
    }
    running = ready[choose(count)];
    self().waits_for = nullptr;
    observe(4);  // that it ran, whatever it saw
    entering_body = &self().body;
    swapcontext(&scheduler, &self().context);
  }
  if (failure.empty())
  {
    // The end knows everything: the newest values become plain ones.
    for (const Location& location : locations)
    {
      *location.raw = location.messages.back().value;
    }
    concurrent = false;
    program.finish();
  }
  concurrent = false;
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
