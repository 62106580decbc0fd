#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "policies/estimates.h"
#include "server/fair_queue.h"
#include "server/lease_book.h"

namespace pi_offload
{

struct AdmissionOptions
{
  int workers = 2;         ///< tasks at once
  size_t max_queued = 32;  ///< of all vehicles
  size_t max_queued_per_vehicle = 8;
  double lease_s = 1.0;          ///< a lease ends without a task or probe for this time
  double lease_turn_s = 0.5;     ///< while others wait, a lease ends after this time
  double max_leased_load = 0.9;  ///< part of the workers' time for leases
  double fair_window_s = 0.25;   ///< service time by which a vehicle counts as ahead or behind at most [s]
  size_t max_vehicles = 256;     ///< known at once; further ones get no leases
  double frequency_ghz = 10.0;   ///< of a worker, for the advertised capacity
  std::array<double, TASK_KINDS> first_service_s{0.05, 0.05};  ///< until tasks are measured
  std::array<bool, TASK_KINDS> served{true, true};

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Decides which tasks a node takes and in which order. Has no threads and no clock.
///
/// - Vehicles hold leases for a rate of tasks. Tasks with a lease go first; others get the time that is left.
/// - A task that cannot end in time is refused at once, so that the vehicle can do it itself. A queued task that loses
///   its turn to another vehicle's task is given out by takeExpired().
/// - The next worker serves the vehicle with the least service time. This is deficit round robin whose deficit outlasts
///   an empty queue by fair_window_s; otherwise a vehicle that is refused in an overload would start from zero each
///   time. Tasks of one vehicle go by deadline.
/// - If leases do not suffice for all, vehicles get them in turn (lease_turn_s).
///
/// Time must not run backwards from call to call. Not thread safe. A copy is independent.
class Admission
{
public:
  /// @throws std::invalid_argument for options.
  explicit Admission(const AdmissionOptions& options);

  enum class Verdict
  {
    TAKEN,
    QUEUE_FULL,
    TOO_LATE,  ///< no answer in time is possible
    DRAINING,
    NOT_SERVED,  ///< not this kind of task
  };
  static const char* toString(Verdict verdict);

  Verdict submit(const ServerTask& task);
  /// The next task for a free worker. Drops expired ones; see takeExpired().
  std::optional<ServerTask> next(int64_t now_ns);
  /// Tasks that were taken but will not be served: they are late, or gave way in a full queue. Call this after submit()
  /// and next().
  std::vector<ServerTask> takeExpired();
  /// A worker ended a task. @param service_s  time on the worker; negative: the task failed and is not counted.
  void finished(uint64_t ticket, double service_s, int64_t now_ns);
  /// Removes a task from the queue. @return false if it is not queued.
  bool cancel(uint64_t ticket);
  /// Drops the vehicle's queued tasks and leases. @return the tickets.
  std::vector<uint64_t> forgetVehicle(const std::string& vehicle);

  /// Asks for a lease or renews one. @param rate_hz  wanted tasks per second; 0 returns the lease.
  /// @return the granted rate: the wanted one, the former one if less is free, or 0. A vehicle that gets 0 and asks
  ///   again within lease_s keeps its place in the line.
  double lease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns);

  void setDraining(bool draining);
  bool draining() const { return draining_; }
  /// The node's state for this vehicle. The caller adds position and range.
  NodeAdvertisement advertisement(const std::string& vehicle, int64_t now_ns) const;

  struct Totals
  {
    uint64_t taken = 0;
    uint64_t refused = 0;
    uint64_t expired = 0;  ///< taken, then given out by takeExpired()
    uint64_t finished = 0;
    double busy_s = 0.0;  ///< sum over the workers
  };
  const Totals& totals() const { return totals_; }
  size_t queued() const { return queue_.size(); }
  size_t running() const { return running_.size(); }

private:
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
    RecentMedian service_s;
    bool tried = false;
    bool outdated = false;  ///< the next measurement is the first one
    int64_t tried_ns = 0;   ///< when a task of the kind began or ended last
  };

  bool known(TaskKind kind) const { return of_kind_[static_cast<size_t>(kind)].service_s.known(); }
  double memory(size_t kind, int64_t now_ns) const;
  double service(size_t kind, int64_t now_ns) const
  {
    return faded(of_kind_[kind].service_s.mean(), options_.first_service_s[kind], kind, now_ns);
  }
  double deviation(size_t kind, int64_t now_ns) const
  {
    return faded(of_kind_[kind].service_s.deviation(), options_.first_service_s[kind] / 2.0, kind, now_ns);
  }
  double faded(double measured_s, double first_s, size_t kind, int64_t now_ns) const
  {
    if (!of_kind_[kind].service_s.known())
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
  bool hasRoom(size_t own, std::optional<uint64_t>* gives_way) const;
  double longestWait(const ServerTask& task, bool covered, size_t own) const;
  Verdict decide(const ServerTask& task);
  void dropExpired(int64_t now_ns);
  void drop(std::vector<QueuedTask> tasks);
  void updateBusy(int64_t now_ns);
  double busyAt(int64_t now_ns, bool covered_only) const;

  AdmissionOptions options_;
  LeaseBook leases_;
  FairQueue queue_;
  std::map<uint64_t, Running> running_;
  std::array<OfKind, TASK_KINDS> of_kind_;
  std::vector<ServerTask> expired_;
  Totals totals_;
  bool draining_ = false;
  double busy_ = 0.0;          ///< mean part of the workers that had a task, at busy_ns_
  double busy_covered_ = 0.0;  ///< that had one covered by a lease
  bool busy_begun_ = false;
  int64_t busy_ns_ = 0;
};

}  // namespace pi_offload
