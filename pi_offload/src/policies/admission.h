#pragma once

#include "engine/node.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace pi_offload
{

struct AdmissionOptions
{
  int workers = 2;         ///< tasks at once
  size_t max_queued = 32;  ///< of all vehicles
  size_t max_queued_per_vehicle = 8;
  double lease_s = 1.0;          ///< a lease ends if it is not renewed by a task or probe for so long
  double lease_turn_s = 0.5;     ///< while others wait for a lease, one is not renewed any more after so long
  double max_leased_load = 0.9;  ///< part of the workers' time that leases may be given for
  double fair_window_s = 0.25;  ///< of service time: so much may a vehicle be ahead of others, or behind, and it counts
  size_t max_vehicles = 256;    ///< that are known at once; leases of others are refused
  double frequency_ghz = 10.0;  ///< of a worker, for the capacity that is advertised
  std::array<double, TASK_KINDS> first_service_s{0.05, 0.05};  ///< until tasks were measured
  std::array<bool, TASK_KINDS> served{true, true};

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A task that a node was asked for.
struct ServerTask
{
  uint64_t ticket = 0;  ///< unique, given by the caller
  std::string vehicle;  ///< who asks
  TaskKind kind = TaskKind::DETECTION;
  int64_t arrived_ns = 0;
  double remaining_s = 0.0;  ///< from arrived_ns, until the answer is worth nothing any more
};

/// Which tasks a node takes, and in which order: without threads and clocks.
///
/// Vehicles have leases for a rate of tasks; what a lease covers is taken as long as the queue lets it end in time, and
/// goes first. What no lease covers is taken where time is left over. A task that cannot end in time by what is known
/// is refused at once, so that the vehicle can do it itself; one that loses its turn to another vehicle's later is
/// given out by takeExpired() at once. Workers serve vehicles in turn by service time: next is the one that has had the
/// least. That is deficit round robin with a deficit that outlasts an empty queue (by fair_window_s), or who is refused
/// in an overload would start from nothing again and again. The tasks of one vehicle go by deadline. Where leases do
/// not suffice for all, they are given in turn (lease_turn_s). Time never runs backwards from call to call. Not thread
/// safe.
class Admission
{
public:
  explicit Admission(const AdmissionOptions& options);
  ~Admission();
  /// A copy goes its own way from there: it shows what would be.
  Admission(const Admission& other);
  Admission& operator=(const Admission& other);

  enum class Verdict
  {
    TAKEN,
    QUEUE_FULL,
    TOO_LATE,  ///< it could not be answered in time
    DRAINING,
    NOT_SERVED,  ///< this kind of task is not served here
  };
  static const char* toString(Verdict verdict);

  Verdict submit(const ServerTask& task);
  /// The next one for a free worker; expired ones are dropped and given out by takeExpired().
  std::optional<ServerTask> next(int64_t now_ns);
  /// Tasks that were taken but will not be served: they cannot end in time any more, or gave way to another vehicle's
  /// in a full queue. To be called after submit() and next().
  std::vector<ServerTask> takeExpired();
  /// The worker of a task is free again. @param service_s  that it took; negative: not to be counted (it failed).
  void finished(uint64_t ticket, double service_s, int64_t now_ns);
  /// A queued task of the vehicle is not wanted any more. @return false if it is not queued.
  bool cancel(uint64_t ticket);
  /// Its tasks in the queue and its leases are dropped. @return the tickets.
  std::vector<uint64_t> forgetVehicle(const std::string& vehicle);

  /// Asks for a lease, or renews it. @param rate_hz  tasks per second wanted; 0 gives it back.
  /// @return the rate granted: all of it or, where less is free, what the vehicle had, or 0. Who gets 0 and asks again
  ///   at least every lease_s waits in line.
  double lease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns);

  void setDraining(bool draining);
  bool draining() const;
  /// As the vehicle would be served. Position and range are left to the caller.
  NodeAdvertisement advertisement(const std::string& vehicle, int64_t now_ns) const;

  struct Totals
  {
    uint64_t taken = 0;
    uint64_t refused = 0;
    uint64_t expired = 0;  ///< taken, but given out by takeExpired()
    uint64_t finished = 0;
    double busy_s = 0.0;  ///< sum over the workers
  };
  const Totals& totals() const;
  size_t queued() const;
  size_t running() const;
  size_t vehicles() const;  ///< with a lease or a task, at the latest time told

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
