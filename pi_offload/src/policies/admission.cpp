#include "policies/admission.h"

#include "policies/estimates.h"
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "wire/durations.h"
#include "server/fair_queue.h"
#include "server/lease_book.h"

namespace pi_offload
{
namespace
{

/// A kind that nobody could be served with for so long is tried again: what is known of its service time may be wrong.
constexpr double TRIAL_PAUSE_S = 1.0;
/// What was measured so long ago counts half, as far as it is slower than the first guess; and nothing any more beside
/// a measurement. Vehicles send nothing to a node that says it is slow, so it would say that for ever.
constexpr double SERVICE_MEMORY_S = 10.0;
/// What an answer may be worth waiting for at most; longer is cut [s].
constexpr double LONGEST_REMAINING_S = 3600.0;
constexpr double LONGEST_SERVICE_S = 3600.0;
/// Of the mean of how busy the workers are.
constexpr double BUSY_TIME_CONSTANT_S = 1.0;
/// Part of the workers' time that is thought to be left beside leases, at least.
constexpr double LEAST_LEFT = 0.05;
/// Part of the time that a task has for waiting: one of a vehicle that has had as much service as others may be let
/// wait for this part of it, less the second one for a vehicle far ahead, plus it for one far behind. So there is
/// always room for those that had less, and little has to be taken back.
constexpr double WAITING_SHARE = 0.6;
constexpr double WAITING_SHARE_RANGE = 0.4;

}  // namespace

void AdmissionOptions::validate() const
{
  const pi_node::OptionCheck check("admission");
  check.range("workers", workers, 1, 1024);
  check.range<size_t>("max_queued", max_queued, 1, 65536);
  check.range<size_t>("max_queued_per_vehicle", max_queued_per_vehicle, 1, max_queued);
  check.range("lease_s", lease_s, 0.01, 3600.0);
  check.range("lease_turn_s", lease_turn_s, 0.01, 3600.0);
  check.range("max_leased_load", max_leased_load, 0.0, 1.0);
  check.range("fair_window_s", fair_window_s, 0.0, 3600.0);
  check.range<size_t>("max_vehicles", max_vehicles, 1, 65536);
  check.range("frequency_ghz", frequency_ghz, 0.0, 1000.0);
  for (const double service_s : first_service_s)
  {
    check.range("first_service_s", service_s, 1e-6, 3600.0);
  }
}

const char* Admission::toString(Verdict verdict)
{
  switch (verdict)
  {
    case Verdict::TAKEN:
      return "taken";
    case Verdict::QUEUE_FULL:
      return "queue full";
    case Verdict::TOO_LATE:
      return "too late";
    case Verdict::DRAINING:
      return "draining";
    case Verdict::NOT_SERVED:
      return "not served";
  }
  return "unknown";
}

struct Admission::Impl
{
  struct Running
  {
    std::string vehicle;
    TaskKind kind = TaskKind::DETECTION;
    bool covered = false;
    int64_t started_ns = 0;
    double expected_s = 0.0;
  };
  struct OfKind
  {
    MeanDeviation service_s;
    bool tried = false;
    bool outdated = false;  ///< the next measurement is the first one
    int64_t tried_ns = 0;   ///< when a task of the kind began or ended last
  };

  explicit Impl(const AdmissionOptions& options)
    : options(options)
    , leases({options.max_leased_load * options.workers, options.lease_s, options.lease_turn_s, options.max_vehicles})
    , queue(options.fair_window_s, options.max_vehicles)
  {
  }

  bool known(TaskKind kind) const { return of_kind[static_cast<size_t>(kind)].service_s.known(); }
  double memory(size_t kind, int64_t now_ns) const;
  double service(size_t kind, int64_t now_ns) const
  {
    return faded(of_kind[kind].service_s.mean(), options.first_service_s[kind], kind, now_ns);
  }
  double deviation(size_t kind, int64_t now_ns) const
  {
    return faded(of_kind[kind].service_s.deviation(), options.first_service_s[kind] / 2.0, kind, now_ns);
  }
  double faded(double measured_s, double first_s, size_t kind, int64_t now_ns) const
  {
    if (!of_kind[kind].service_s.known())
    {
      return first_s;
    }
    return measured_s <= first_s ? measured_s : first_s + memory(kind, now_ns) * (measured_s - first_s);
  }
  std::array<double, TASK_KINDS> services(int64_t now_ns) const
  {
    std::array<double, TASK_KINDS> all{};
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      all[kind] = service(kind, now_ns);
    }
    return all;
  }

  std::vector<int64_t> workersFreeAt(int64_t now_ns) const;
  bool certainlyLate(const QueuedTask& task, int64_t start_ns, int64_t now_ns) const;
  template <typename Visit>
  void schedule(int64_t now_ns, const QueuedTask* extra, const Visit& visit) const;
  bool mayTry(TaskKind kind, int64_t now_ns) const;
  void dropExpired(int64_t now_ns);
  void drop(std::vector<QueuedTask> tasks);
  void updateBusy(int64_t now_ns);
  double busyAt(int64_t now_ns, bool covered_only) const;

  AdmissionOptions options;
  LeaseBook leases;
  FairQueue queue;
  std::map<uint64_t, Running> running;
  std::array<OfKind, TASK_KINDS> of_kind;
  std::vector<ServerTask> expired;
  Totals totals;
  bool draining = false;
  int64_t latest_ns = INT64_MIN;  ///< latest time told
  double busy = 0.0;              ///< mean part of the workers that had a task, at busy_ns
  double busy_covered = 0.0;      ///< that had one covered by a lease
  bool busy_begun = false;
  int64_t busy_ns = 0;
};

/// How much of what was measured of the kind counts yet: 1 while a task of it runs, then less and less.
double Admission::Impl::memory(size_t kind, int64_t now_ns) const
{
  const bool runs = std::any_of(running.begin(), running.end(),
                                [&](const auto& task) { return static_cast<size_t>(task.second.kind) == kind; });
  const double memories = runs ? 0.0 : std::max(0.0, secondsBetween(of_kind[kind].tried_ns, now_ns)) / SERVICE_MEMORY_S;
  return 1.0 / (1.0 + memories * memories);
}

/// When each worker has ended what it is at, the earliest first.
std::vector<int64_t> Admission::Impl::workersFreeAt(int64_t now_ns) const
{
  std::vector<int64_t> free_ns;
  for (const auto& entry : running)
  {
    const Running& task = entry.second;
    const double left_s = task.expected_s - secondsBetween(task.started_ns, now_ns);
    // One that takes longer than expected: nobody knows, so the usual deviation.
    free_ns.push_back(now_ns + nanoseconds(left_s > 0.0 ? left_s : deviation(static_cast<size_t>(task.kind), now_ns)));
  }
  std::sort(free_ns.begin(), free_ns.end());
  free_ns.resize(static_cast<size_t>(options.workers), now_ns);
  std::sort(free_ns.begin(), free_ns.end());
  return free_ns;
}

/// Whether there is no use in starting it then.
bool Admission::Impl::certainlyLate(const QueuedTask& task, int64_t start_ns, int64_t now_ns) const
{
  const auto kind = static_cast<size_t>(task.task.kind);
  const bool by_clock_only = task.trial || !of_kind[kind].service_s.known();
  const double least_s = by_clock_only ? 0.0 : std::max(0.0, service(kind, now_ns) - deviation(kind, now_ns));
  return start_ns + nanoseconds(least_s) >= task.deadline_ns;
}

/// Calls `visit(task, start_ns)` for the tasks in the order in which they would be served by what is
/// known; those that would be dropped take no time.
template <typename Visit>
void Admission::Impl::schedule(int64_t now_ns, const QueuedTask* extra, const Visit& visit) const
{
  std::vector<int64_t> free_ns = workersFreeAt(now_ns);
  // Tasks with leases will come and go before those without: they leave only a part of the workers' time.
  const double stretch = 1.0 / std::max(LEAST_LEFT, 1.0 - busyAt(now_ns, true));
  const auto later = [](int64_t a, int64_t b) { return a > b; };
  std::make_heap(free_ns.begin(), free_ns.end(), later);
  queue.plan(services(now_ns), extra,
             [&](const QueuedTask& task)
             {
               const int64_t start_ns = std::max(now_ns, free_ns.front());
               const int64_t end_ns = start_ns + nanoseconds(service(static_cast<size_t>(task.task.kind), now_ns));
               visit(task, start_ns);
               if (certainlyLate(task, start_ns, now_ns))
               {
                 return false;
               }
               std::pop_heap(free_ns.begin(), free_ns.end(), later);
               free_ns.back() = task.covered
                                    ? end_ns
                                    : start_ns + static_cast<int64_t>(static_cast<double>(end_ns - start_ns) * stretch);
               std::push_heap(free_ns.begin(), free_ns.end(), later);
               return true;
             });
}

/// Whether a task that would be too late by its service time alone is taken all the same, to measure that again.
bool Admission::Impl::mayTry(TaskKind kind, int64_t now_ns) const
{
  const OfKind& of = of_kind[static_cast<size_t>(kind)];
  return queue.size() == 0 && running.size() < static_cast<size_t>(options.workers) &&
         (!of.tried || secondsBetween(of.tried_ns, now_ns) >= TRIAL_PAUSE_S);
}

void Admission::Impl::drop(std::vector<QueuedTask> tasks)
{
  for (QueuedTask& task : tasks)
  {
    ++totals.expired;
    expired.push_back(std::move(task.task));
  }
}

void Admission::Impl::dropExpired(int64_t now_ns)
{
  drop(queue.removeIf([&](const QueuedTask& task) { return certainlyLate(task, now_ns, now_ns); }));
}

double Admission::Impl::busyAt(int64_t now_ns, bool covered_only) const
{
  const double passed_s = busy_begun ? std::max(0.0, secondsBetween(busy_ns, now_ns)) : 0.0;
  const auto count = std::count_if(running.begin(), running.end(),
                                   [&](const auto& task) { return !covered_only || task.second.covered; });
  const double present = std::min(1.0, static_cast<double>(count) / static_cast<double>(options.workers));
  const double mean = covered_only ? busy_covered : busy;
  return present + (mean - present) * std::exp(-passed_s / BUSY_TIME_CONSTANT_S);
}

/// Before `running` changes.
void Admission::Impl::updateBusy(int64_t now_ns)
{
  busy = busyAt(now_ns, false);
  busy_covered = busyAt(now_ns, true);
  busy_ns = busy_begun ? std::max(busy_ns, now_ns) : now_ns;
  busy_begun = true;
}

Admission::Admission(const AdmissionOptions& options)
{
  options.validate();
  impl_ = std::make_unique<Impl>(options);
}

Admission::~Admission() = default;

Admission::Admission(const Admission& other) : impl_(std::make_unique<Impl>(*other.impl_)) {}

Admission& Admission::operator=(const Admission& other)
{
  if (this != &other)
  {
    impl_ = std::make_unique<Impl>(*other.impl_);
  }
  return *this;
}

Admission::Verdict Admission::submit(const ServerTask& task)
{
  Impl& impl = *impl_;
  const auto kind = static_cast<size_t>(task.kind);
  const auto refuse = [&](Verdict verdict)
  {
    ++impl.totals.refused;
    return verdict;
  };
  if (kind >= TASK_KINDS || !impl.options.served[kind])
  {
    return refuse(Verdict::NOT_SERVED);
  }
  if (impl.draining)
  {
    return refuse(Verdict::DRAINING);
  }
  if (!(task.remaining_s > 0.0))
  {
    return refuse(Verdict::TOO_LATE);
  }
  const int64_t now_ns = task.arrived_ns;
  impl.latest_ns = std::max(impl.latest_ns, now_ns);
  impl.dropExpired(now_ns);
  impl.leases.renew(task.vehicle, task.kind, impl.services(now_ns), now_ns);
  const size_t own = impl.queue.count(task.vehicle);
  if (own >= impl.options.max_queued_per_vehicle)
  {
    return refuse(Verdict::QUEUE_FULL);
  }
  // A full queue: the vehicle that has most of it gives way, if it has more than this one would have.
  std::optional<uint64_t> gives_way;
  if (impl.queue.size() >= impl.options.max_queued)
  {
    const QueuedTask* last = impl.queue.lastOfLongest(own + 2);
    if (last == nullptr)
    {
      return refuse(Verdict::QUEUE_FULL);
    }
    gives_way = last->task.ticket;
  }

  QueuedTask queued;
  queued.task = task;
  queued.deadline_ns = now_ns + nanoseconds(std::min(task.remaining_s, LONGEST_REMAINING_S));
  queued.covered = impl.leases.covers(task.vehicle, task.kind, now_ns);
  const bool in_time_alone =
      impl.service(kind, now_ns) + impl.deviation(kind, now_ns) <= task.remaining_s || !impl.known(task.kind);
  if (!in_time_alone)
  {
    if (!impl.mayTry(task.kind, now_ns))
    {
      return refuse(Verdict::TOO_LATE);
    }
    queued.trial = true;
  }
  const uint64_t ticket = task.ticket;
  const bool covered = queued.covered;
  const bool checked = !queued.trial && impl.known(task.kind);
  const bool alone =
      own == impl.queue.size() && std::all_of(impl.running.begin(), impl.running.end(),
                                              [&](const auto& other) { return other.second.vehicle == task.vehicle; });
  const double share = alone ? 1.0 : WAITING_SHARE - WAITING_SHARE_RANGE * impl.queue.ahead(task.vehicle, covered);
  const double longest_wait_s = share * (task.remaining_s - impl.service(kind, now_ns) - impl.deviation(kind, now_ns));
  impl.queue.add(std::move(queued));

  bool in_time = true;
  std::set<uint64_t> late;
  impl.schedule(now_ns, nullptr,
                [&](const QueuedTask& other, int64_t start_ns)
                {
                  if (other.task.ticket == ticket)
                  {
                    in_time = !checked || secondsBetween(now_ns, start_ns) <= longest_wait_s;
                  }
                  else if (!other.covered && impl.certainlyLate(other, start_ns, now_ns))
                  {
                    late.insert(other.task.ticket);
                  }
                });
  if (!in_time)
  {
    impl.queue.remove(ticket);
    return refuse(Verdict::TOO_LATE);
  }
  ++impl.totals.taken;
  if (covered)
  {
    impl.leases.use(task.vehicle, task.kind, now_ns);
  }
  // Those that lose their turn to it are told at once, not when their time is over.
  impl.drop(impl.queue.removeIf(
      [&](const QueuedTask& other)
      { return late.count(other.task.ticket) != 0 || (gives_way && other.task.ticket == *gives_way); }));
  return Verdict::TAKEN;
}

std::optional<ServerTask> Admission::next(int64_t now_ns)
{
  Impl& impl = *impl_;
  impl.latest_ns = std::max(impl.latest_ns, now_ns);
  impl.dropExpired(now_ns);
  std::optional<QueuedTask> queued = impl.queue.pop(impl.services(now_ns));
  if (!queued)
  {
    return std::nullopt;
  }
  impl.updateBusy(now_ns);
  const auto kind = static_cast<size_t>(queued->task.kind);
  Impl::OfKind& of = impl.of_kind[kind];
  const double service_s = impl.service(kind, now_ns);
  of.outdated = of.outdated || (of.tried && impl.memory(kind, now_ns) < 0.5);
  of.tried = true;
  of.tried_ns = now_ns;
  impl.running[queued->task.ticket] =
      Impl::Running{queued->task.vehicle, queued->task.kind, queued->covered, now_ns, service_s};
  return std::move(queued->task);
}

std::vector<ServerTask> Admission::takeExpired()
{
  return std::exchange(impl_->expired, {});
}

void Admission::finished(uint64_t ticket, double service_s, int64_t now_ns)
{
  Impl& impl = *impl_;
  const auto found = impl.running.find(ticket);
  if (found == impl.running.end())
  {
    return;
  }
  impl.latest_ns = std::max(impl.latest_ns, now_ns);
  impl.updateBusy(now_ns);
  const Impl::Running task = std::move(found->second);
  impl.running.erase(found);
  ++impl.totals.finished;
  Impl::OfKind& of = impl.of_kind[static_cast<size_t>(task.kind)];
  of.tried_ns = now_ns;
  if (std::isfinite(service_s) && service_s >= 0.0)
  {
    const double counted_s = std::min(service_s, LONGEST_SERVICE_S);
    impl.totals.busy_s += counted_s;
    if (std::exchange(of.outdated, false))
    {
      of.service_s.reset();
    }
    of.service_s.add(counted_s);
    impl.queue.correct(task.vehicle, task.covered, counted_s - task.expected_s);
  }
}

bool Admission::cancel(uint64_t ticket)
{
  return impl_->queue.remove(ticket).has_value();
}

std::vector<uint64_t> Admission::forgetVehicle(const std::string& vehicle)
{
  std::vector<uint64_t> tickets;
  for (const QueuedTask& task : impl_->queue.removeVehicle(vehicle))
  {
    tickets.push_back(task.task.ticket);
  }
  impl_->leases.forget(vehicle);
  return tickets;
}

double Admission::lease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns)
{
  const auto index = static_cast<size_t>(kind);
  if (index >= TASK_KINDS || !impl_->options.served[index] || impl_->draining)
  {
    return 0.0;
  }
  impl_->latest_ns = std::max(impl_->latest_ns, now_ns);
  return impl_->leases.ask(vehicle, kind, rate_hz, impl_->services(now_ns), now_ns);
}

void Admission::setDraining(bool draining)
{
  impl_->draining = draining;
  if (draining)
  {
    impl_->leases.clear();
  }
}

bool Admission::draining() const
{
  return impl_->draining;
}

NodeAdvertisement Admission::advertisement(const std::string& vehicle, int64_t now_ns) const
{
  const Impl& impl = *impl_;
  NodeAdvertisement advertisement;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    NodeAdvertisement::OfKind& of = advertisement.of_kind[kind];
    of.served = impl.options.served[kind];
    if (!of.served)
    {
      continue;
    }
    of.service_s = impl.service(kind, now_ns);
    of.service_deviation_s = impl.deviation(kind, now_ns);
    of.lease_rate_hz = impl.leases.rate(vehicle, static_cast<TaskKind>(kind), now_ns);
    of.lease_until_s = impl.leases.holdsFor(vehicle, static_cast<TaskKind>(kind), now_ns);

    QueuedTask asked;
    asked.task.vehicle = vehicle;
    asked.task.kind = static_cast<TaskKind>(kind);
    asked.deadline_ns = INT64_MAX;
    asked.covered = of.lease_rate_hz > 0.0;
    asked.serial = UINT64_MAX;
    impl.schedule(now_ns, &asked,
                  [&](const QueuedTask& task, int64_t start_ns)
                  {
                    if (&task == &asked)
                    {
                      of.queue_s = secondsBetween(now_ns, start_ns);
                    }
                  });
  }
  const double used =
      std::max(impl.busyAt(now_ns, false), impl.leases.load(impl.services(now_ns), now_ns) / impl.options.workers);
  advertisement.capacity_gcycles =
      impl.draining ? 0.0 : std::max(0.0, 1.0 - used) * impl.options.workers * impl.options.frequency_ghz;
  advertisement.draining = impl.draining;
  return advertisement;
}

const Admission::Totals& Admission::totals() const
{
  return impl_->totals;
}

size_t Admission::queued() const
{
  return impl_->queue.size();
}

size_t Admission::running() const
{
  return impl_->running.size();
}

size_t Admission::vehicles() const
{
  std::set<std::string> names;
  const auto add = [&](const std::string& name) { names.insert(name); };
  impl_->queue.forEachVehicle(add);
  impl_->leases.forEachHolder(impl_->latest_ns, add);
  for (const auto& task : impl_->running)
  {
    names.insert(task.second.vehicle);
  }
  return names.size();
}

}  // namespace pi_offload
