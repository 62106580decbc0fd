#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/admission.h"
#include "simulation/world.h"

namespace pi_offload::simulation
{

/// A task that reaches a node.
struct Arrival
{
  ServerTask task;
  double service_s = 0.0;
  double lease_hz = 0.0;  ///< rate of the lease asked for; 0: none
};

/// A node: Admission, workers, and tasks of other vehicles. The oracle copies it to look ahead.
class EdgeNode
{
public:
  /// End of a task of our vehicles.
  struct End
  {
    uint64_t ticket = 0;
    int64_t at_ns = 0;
    bool done = false;  ///< false: dropped because its time was over
    double queue_s = 0.0;
    double service_s = 0.0;
  };

  /// @param world  must outlive this.
  EdgeNode(const World& world, size_t node);

  /// Advances to now_ns, inclusive; adds ended tasks to `ends`. The calls below are for the same instant.
  void advance(int64_t now_ns, std::vector<End>* ends);
  /// When to call advance() for our tasks; INT64_MAX: not needed.
  int64_t nextTime() const;
  /// A free worker begins at once. Adds superseded tasks to `ends`.
  Admission::Verdict arrive(const Arrival& arrival, std::vector<End>* ends);
  void cancel(uint64_t ticket);
  /// @param rate_hz  0 returns the lease.
  void askLease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns);
  NodeAdvertisement advertisement(const std::string& vehicle, int64_t now_ns) const;
  /// A copy with other tasks of others to come. @param others  in the order of arrival; must outlive the copy
  EdgeNode withOthers(const std::vector<OthersTask>* others) const;
  /// Loses all state.
  void restart(int64_t now_ns);

  double busy_s() const { return busy_s_; }  ///< of all workers

private:
  struct Running
  {
    ServerTask task;
    int64_t started_ns = 0;
    int64_t ends_ns = 0;
    double service_s = 0.0;
  };

  void start(int64_t now_ns, std::vector<End>* ends);
  void dropExpired(int64_t now_ns, std::vector<End>* ends);
  size_t firstToEnd() const;

  const World* world_;
  size_t node_;
  AdmissionOptions options_;
  Admission admission_;
  const std::vector<OthersTask>* others_;
  size_t next_other_ = 0;
  std::map<uint64_t, double> service_s_;  ///< of queued tasks
  std::vector<Running> running_;
  size_t ours_queued_ = 0;
  size_t ours_running_ = 0;
  double busy_s_ = 0.0;
};

}  // namespace pi_offload::simulation
