#include "server/admission.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace pi_offload
{
namespace
{

/// After this time without a served task of a kind, one is tried: the known service time may be wrong.
constexpr double TRIAL_PAUSE_S = 1.0;
/// A measurement of this age that is slower than the first guess counts half, and is replaced by the next measurement.
/// Otherwise a node that says it is slow gets no tasks, and says so for ever.
constexpr double MEASURED_MEMORY_S = 10.0;
/// Longer times are cut to these [s].
constexpr double LONGEST_REMAINING_S = 3600.0;
constexpr double LONGEST_SERVICE_S = 3600.0;
/// Of the mean load of the workers.
constexpr double BUSY_TIME_CONSTANT_S = 1.0;
/// Least part of the workers' time that counts as left beside leases.
constexpr double LEAST_LEFT = 0.05;
/// Part of its spare time that a task may wait: WAITING_SHARE for a vehicle with as much service as others, less
/// WAITING_SHARE_RANGE for one far ahead, plus WAITING_SHARE_RANGE for one far behind. This keeps room for vehicles
/// that had less service.
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

/// Weight of what was measured of the kind: 1 while a task of it runs, then less and less.
double Admission::memory(size_t kind, int64_t now_ns) const
{
  const bool runs = std::any_of(running_.begin(), running_.end(),
                                [&](const auto& task) { return static_cast<size_t>(task.second.kind) == kind; });
  const double memories =
      runs ? 0.0 : std::max(0.0, pi_node::secondsBetween(of_kind_[kind].tried_ns, now_ns)) / MEASURED_MEMORY_S;
  return 1.0 / (1.0 + memories * memories);
}

/// When each worker becomes free, the earliest first.
std::vector<int64_t> Admission::workersFreeAt(int64_t now_ns) const
{
  std::vector<int64_t> free_ns;
  for (const auto& entry : running_)
  {
    const Running& task = entry.second;
    const double left_s = task.expected_s - pi_node::secondsBetween(task.started_ns, now_ns);
    // A task that takes longer than expected is assumed to need one more deviation.
    free_ns.push_back(now_ns +
                      pi_node::nanoseconds(left_s > 0.0 ? left_s : deviation(static_cast<size_t>(task.kind), now_ns)));
  }
  std::sort(free_ns.begin(), free_ns.end());
  free_ns.resize(static_cast<size_t>(options_.workers), now_ns);
  std::sort(free_ns.begin(), free_ns.end());
  return free_ns;
}

/// Whether the task would be late if it started then.
bool Admission::certainlyLate(const QueuedTask& task, int64_t start_ns, int64_t now_ns) const
{
  const auto kind = static_cast<size_t>(task.task.kind);
  const bool by_clock_only = task.trial || !of_kind_[kind].service_s.known();
  const double least_s = by_clock_only ? 0.0 : std::max(0.0, service(kind, now_ns) - deviation(kind, now_ns));
  return start_ns + pi_node::nanoseconds(least_s) >= task.deadline_ns;
}

/// Calls `visit(task, start_ns)` for all tasks in the expected order of service; tasks that would be dropped take no
/// time.
template <typename Visit>
void Admission::schedule(int64_t now_ns, const QueuedTask* extra, const Visit& visit) const
{
  std::vector<int64_t> free_ns = workersFreeAt(now_ns);
  // Tasks with leases will arrive and go first; they leave only a part of the workers' time.
  const double stretch = 1.0 / std::max(LEAST_LEFT, 1.0 - busyAt(now_ns, true));
  const auto later = [](int64_t a, int64_t b) { return a > b; };
  std::make_heap(free_ns.begin(), free_ns.end(), later);
  queue_.plan(
      services(now_ns), extra,
      [&](const QueuedTask& task)
      {
        const int64_t start_ns = std::max(now_ns, free_ns.front());
        const int64_t end_ns = start_ns + pi_node::nanoseconds(service(static_cast<size_t>(task.task.kind), now_ns));
        visit(task, start_ns);
        if (certainlyLate(task, start_ns, now_ns))
        {
          return false;
        }
        std::pop_heap(free_ns.begin(), free_ns.end(), later);
        free_ns.back() =
            task.covered ? end_ns : start_ns + static_cast<int64_t>(static_cast<double>(end_ns - start_ns) * stretch);
        std::push_heap(free_ns.begin(), free_ns.end(), later);
        return true;
      });
}

/// Whether a task that seems too slow is taken to measure its kind again.
bool Admission::mayTry(TaskKind kind, int64_t now_ns) const
{
  const OfKind& of = of_kind_[static_cast<size_t>(kind)];
  return queue_.size() == 0 && running_.size() < static_cast<size_t>(options_.workers) &&
         (!of.tried || pi_node::secondsBetween(of.tried_ns, now_ns) >= TRIAL_PAUSE_S);
}

void Admission::drop(std::vector<QueuedTask> tasks)
{
  for (QueuedTask& task : tasks)
  {
    ++totals_.expired;
    expired_.push_back(std::move(task.task));
  }
}

void Admission::dropExpired(int64_t now_ns)
{
  drop(queue_.removeIf([&](const QueuedTask& task) { return certainlyLate(task, now_ns, now_ns); }));
}

double Admission::busyAt(int64_t now_ns, bool covered_only) const
{
  const double passed_s = busy_begun_ ? std::max(0.0, pi_node::secondsBetween(busy_ns_, now_ns)) : 0.0;
  const auto count = std::count_if(running_.begin(), running_.end(),
                                   [&](const auto& task) { return !covered_only || task.second.covered; });
  const double present = std::min(1.0, static_cast<double>(count) / static_cast<double>(options_.workers));
  const double mean = covered_only ? busy_covered_ : busy_;
  return present + (mean - present) * std::exp(-passed_s / BUSY_TIME_CONSTANT_S);
}

/// Before `running_` changes.
void Admission::updateBusy(int64_t now_ns)
{
  busy_ = busyAt(now_ns, false);
  busy_covered_ = busyAt(now_ns, true);
  busy_ns_ = busy_begun_ ? std::max(busy_ns_, now_ns) : now_ns;
  busy_begun_ = true;
}

Admission::Admission(const AdmissionOptions& options)
  : options_((options.validate(), options))
  , leases_({options.max_leased_load * options.workers, options.lease_s, options.lease_turn_s, options.max_vehicles})
  , queue_(options.fair_window_s, options.max_vehicles)
{
}

Admission::Verdict Admission::submit(const ServerTask& task)
{
  const Verdict verdict = decide(task);
  ++(verdict == Verdict::TAKEN ? totals_.taken : totals_.refused);
  return verdict;
}

/// Whether the queue has room for one task more of a vehicle that has `own` in it.
/// @param[out] gives_way  the task of the vehicle with most tasks that makes room in a full queue.
bool Admission::hasRoom(size_t own, std::optional<uint64_t>* gives_way) const
{
  if (own >= options_.max_queued_per_vehicle)
  {
    return false;
  }
  if (queue_.size() >= options_.max_queued)
  {
    const QueuedTask* last = queue_.lastOfLongest(own + 2);
    if (last == nullptr)
    {
      return false;
    }
    *gives_way = last->task.ticket;
  }
  return true;
}

/// How long the task may wait in the queue [s]. @param own  tasks of its vehicle in the queue.
double Admission::longestWait(const ServerTask& task, bool covered, size_t own) const
{
  const auto kind = static_cast<size_t>(task.kind);
  const bool alone =
      own == queue_.size() && std::all_of(running_.begin(), running_.end(),
                                          [&](const auto& other) { return other.second.vehicle == task.vehicle; });
  const double share = alone ? 1.0 : WAITING_SHARE - WAITING_SHARE_RANGE * queue_.ahead(task.vehicle, covered);
  return share * (task.remaining_s - service(kind, task.arrived_ns) - deviation(kind, task.arrived_ns));
}

Admission::Verdict Admission::decide(const ServerTask& task)
{
  const auto kind = static_cast<size_t>(task.kind);
  if (kind >= TASK_KINDS || !options_.served[kind])
  {
    return Verdict::NOT_SERVED;
  }
  if (draining_)
  {
    return Verdict::DRAINING;
  }
  if (!(task.remaining_s > 0.0))
  {
    return Verdict::TOO_LATE;
  }
  const int64_t now_ns = task.arrived_ns;
  dropExpired(now_ns);
  leases_.renew(task.vehicle, task.kind, services(now_ns), now_ns);
  const size_t own = queue_.count(task.vehicle);
  std::optional<uint64_t> gives_way;
  if (!hasRoom(own, &gives_way))
  {
    return Verdict::QUEUE_FULL;
  }
  QueuedTask queued;
  queued.task = task;
  queued.deadline_ns = now_ns + pi_node::nanoseconds(std::min(task.remaining_s, LONGEST_REMAINING_S));
  queued.covered = leases_.covers(task.vehicle, task.kind, now_ns);
  if (known(task.kind) && service(kind, now_ns) + deviation(kind, now_ns) > task.remaining_s)
  {
    if (!mayTry(task.kind, now_ns))
    {
      return Verdict::TOO_LATE;
    }
    queued.trial = true;
  }
  const bool covered = queued.covered;
  const bool checked = !queued.trial && known(task.kind);
  const double longest_wait_s = checked ? longestWait(task, covered, own) : HUGE_VAL;
  queue_.add(std::move(queued));

  bool in_time = true;
  std::set<uint64_t> late;  // tasks of others that lose their turn to this one
  schedule(now_ns, nullptr,
           [&](const QueuedTask& other, int64_t start_ns)
           {
             if (other.task.ticket == task.ticket)
             {
               in_time = pi_node::secondsBetween(now_ns, start_ns) <= longest_wait_s;
             }
             else if (!other.covered && certainlyLate(other, start_ns, now_ns))
             {
               late.insert(other.task.ticket);
             }
           });
  if (!in_time)
  {
    queue_.remove(task.ticket);
    return Verdict::TOO_LATE;
  }
  if (covered)
  {
    leases_.use(task.vehicle, task.kind, now_ns);
  }
  // Their vehicles are told now, not when the time of the tasks is over.
  drop(queue_.removeIf(
      [&](const QueuedTask& other)
      { return late.count(other.task.ticket) != 0 || (gives_way && other.task.ticket == *gives_way); }));
  return Verdict::TAKEN;
}

std::optional<ServerTask> Admission::next(int64_t now_ns)
{
  dropExpired(now_ns);
  std::optional<QueuedTask> queued = queue_.pop(services(now_ns));
  if (!queued)
  {
    return std::nullopt;
  }
  updateBusy(now_ns);
  const auto kind = static_cast<size_t>(queued->task.kind);
  OfKind& of = of_kind_[kind];
  const double service_s = service(kind, now_ns);
  of.outdated = of.outdated || (of.tried && memory(kind, now_ns) < 0.5);
  of.tried = true;
  of.tried_ns = now_ns;
  running_[queued->task.ticket] = Running{queued->task.vehicle, queued->task.kind, queued->covered, now_ns, service_s};
  return std::move(queued->task);
}

std::vector<ServerTask> Admission::takeExpired()
{
  return std::exchange(expired_, {});
}

void Admission::finished(uint64_t ticket, double service_s, int64_t now_ns)
{
  const auto found = running_.find(ticket);
  if (found == running_.end())
  {
    return;
  }
  updateBusy(now_ns);
  const Running task = std::move(found->second);
  running_.erase(found);
  ++totals_.finished;
  OfKind& of = of_kind_[static_cast<size_t>(task.kind)];
  of.tried_ns = now_ns;
  if (std::isfinite(service_s) && service_s >= 0.0)
  {
    const double counted_s = std::min(service_s, LONGEST_SERVICE_S);
    totals_.busy_s += counted_s;
    if (std::exchange(of.outdated, false))
    {
      of.service_s.reset();
    }
    of.service_s.add(counted_s);
    queue_.correct(task.vehicle, task.covered, counted_s - task.expected_s);
  }
}

bool Admission::cancel(uint64_t ticket)
{
  return queue_.remove(ticket).has_value();
}

std::vector<uint64_t> Admission::forgetVehicle(const std::string& vehicle)
{
  std::vector<uint64_t> tickets;
  for (const QueuedTask& task : queue_.removeVehicle(vehicle))
  {
    tickets.push_back(task.task.ticket);
  }
  leases_.forget(vehicle);
  return tickets;
}

double Admission::lease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns)
{
  const auto index = static_cast<size_t>(kind);
  if (index >= TASK_KINDS || !options_.served[index] || draining_)
  {
    return 0.0;
  }
  return leases_.ask(vehicle, kind, rate_hz, services(now_ns), now_ns);
}

void Admission::setDraining(bool draining)
{
  draining_ = draining;
  if (draining_)
  {
    leases_.clear();
  }
}

NodeAdvertisement Admission::advertisement(const std::string& vehicle, int64_t now_ns) const
{
  NodeAdvertisement advertisement;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    NodeAdvertisement::OfKind& of = advertisement.of_kind[kind];
    of.served = options_.served[kind];
    if (!of.served)
    {
      continue;
    }
    of.service_s = service(kind, now_ns);
    of.service_deviation_s = deviation(kind, now_ns);
    of.lease_rate_hz = leases_.rate(vehicle, static_cast<TaskKind>(kind), now_ns);
    of.lease_until_s = leases_.holdsFor(vehicle, static_cast<TaskKind>(kind), now_ns);

    QueuedTask asked;
    asked.task.vehicle = vehicle;
    asked.task.kind = static_cast<TaskKind>(kind);
    asked.deadline_ns = INT64_MAX;
    asked.covered = of.lease_rate_hz > 0.0;
    asked.serial = UINT64_MAX;
    schedule(now_ns, &asked,
             [&](const QueuedTask& task, int64_t start_ns)
             {
               if (&task == &asked)
               {
                 of.queue_s = pi_node::secondsBetween(now_ns, start_ns);
               }
             });
  }
  const double used = std::max(busyAt(now_ns, false), leases_.load(services(now_ns), now_ns) / options_.workers);
  advertisement.capacity_gcycles =
      draining_ ? 0.0 : std::max(0.0, 1.0 - used) * options_.workers * options_.frequency_ghz;
  advertisement.draining = draining_;
  return advertisement;
}

}  // namespace pi_offload
