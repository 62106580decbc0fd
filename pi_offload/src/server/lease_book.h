#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <string>

#include "engine/node.h"

namespace pi_offload
{

/// Leases of vehicles for a rate of tasks, together at most a part of the workers' time.
///
/// A vehicle without a lease waits. While a vehicle waits, leases end after their turn, so that all get one in turn.
/// Not thread safe.
class LeaseBook
{
public:
  struct Options
  {
    double max_load = 0.0;  ///< of all leases: sum of rate times service time
    double lease_s = 1.0;   ///< duration without renewal
    double turn_s = 2.0;    ///< duration while others wait
    size_t max_vehicles = 256;
  };
  using Services = std::array<double, TASK_KINDS>;  ///< mean service time of each kind [s]

  explicit LeaseBook(const Options& options) : options_(options) {}

  /// Asks for a lease or renews one. @return its rate; 0: none.
  double ask(const std::string& vehicle, TaskKind kind, double rate_hz, const Services& services, int64_t now_ns);
  /// Renews a lease at its rate, if there is one.
  void renew(const std::string& vehicle, TaskKind kind, const Services& services, int64_t now_ns);
  /// Whether the vehicle's lease covers one more task.
  bool covers(const std::string& vehicle, TaskKind kind, int64_t now_ns) const;
  /// Counts one task against the lease.
  void use(const std::string& vehicle, TaskKind kind, int64_t now_ns);

  void forget(const std::string& vehicle) { vehicles_.erase(vehicle); }
  void clear() { vehicles_.clear(); }

  double rate(const std::string& vehicle, TaskKind kind, int64_t now_ns) const;      ///< 0: no lease
  double holdsFor(const std::string& vehicle, TaskKind kind, int64_t now_ns) const;  ///< [s]; 0: no lease
  /// Load of all leases, in workers.
  double load(const Services& services, int64_t now_ns) const;

private:
  struct Lease
  {
    bool held = false;
    double rate_hz = 0.0;
    int64_t until_ns = 0;
    int64_t held_since_ns = 0;
    double tokens = 0.0;  ///< tasks that it covers at tokens_ns
    int64_t tokens_ns = 0;

    bool waiting = false;
    double wanted_hz = 0.0;
    int64_t order = 0;  ///< among waiting vehicles
    int64_t asked_ns = 0;
  };
  using Leases = std::array<Lease, TASK_KINDS>;

  const Lease* find(const std::string& vehicle, TaskKind kind, int64_t now_ns) const;
  double tokensOf(const Lease& lease, int64_t now_ns) const;
  struct Room
  {
    double left = 0.0;                                               ///< workers' time
    double least_refused = std::numeric_limits<double>::infinity();  ///< smallest wish that did not fit
  };
  Room roomBefore(int64_t order, const Services& services, int64_t now_ns) const;
  void wait(Lease* lease, double rate_hz, int64_t now_ns);
  void sweep(int64_t now_ns);

  Options options_;
  std::map<std::string, Leases> vehicles_;
  int64_t next_order_ = 0;
  int64_t swept_ns_ = INT64_MIN;
};

}  // namespace pi_offload
