#pragma once

#include "simulation/world.h"

#include "policies/admission.h"

#include <map>
#include <string>
#include <vector>

namespace pi_offload::simulation
{

/// A task as it reaches a node.
struct Arrival
{
  ServerTask task;
  double service_s = 0.0;
  double lease_hz = 0.0;  ///< that is asked for with it; 0: no lease
};

/// A node: Admission, workers, and the others that use it too. A copy goes its own way from there, so that it shows
/// what would be.
class EdgeNode
{
public:
  /// What became of a task of ours.
  struct End
  {
    uint64_t ticket = 0;
    int64_t at_ns = 0;
    bool done = false;  ///< false: dropped, its time being over
    double queue_s = 0.0;
    double service_s = 0.0;
  };

  /// @param world  must outlive this.
  EdgeNode(const World& world, size_t node);

  /// Lets the time pass up to and with now; what ended is added to `ends`. Calls below are for the same instant.
  void advance(int64_t now_ns, std::vector<End>* ends);
  /// What may change for tasks of ours, then: advance() wants to be called; INT64_MAX: nothing.
  int64_t nextTime() const;
  /// A worker that is free begins at once; tasks that it supersedes are added to `ends`.
  Admission::Verdict arrive(const Arrival& arrival, std::vector<End>* ends);
  void cancel(uint64_t ticket);
  /// 0 gives it back.
  void askLease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns);
  NodeAdvertisement advertisement(const std::string& vehicle, int64_t now_ns) const;
  /// All that it had is lost; it begins anew.
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
  size_t next_other_ = 0;
  std::map<uint64_t, double> service_s_;  ///< of what is queued
  std::vector<Running> running_;
  size_t ours_queued_ = 0;
  size_t ours_running_ = 0;
  double busy_s_ = 0.0;
};

}  // namespace pi_offload::simulation
