#pragma once

#include <cmath>

#include "simulation/loop_route.h"
#include "simulation/simulation.h"

namespace pi_offload::simulation
{

// Results in docs/ depend on this rounding; pi_node::nanoseconds() truncates.
constexpr double NS_PER_S = 1e9;
inline int64_t toNs(double seconds)
{
  return static_cast<int64_t>(std::llround(seconds * NS_PER_S));
}
inline double toS(int64_t ns)
{
  return static_cast<double>(ns) / NS_PER_S;
}

/// A task of another vehicle at a node.
struct OthersTask
{
  int64_t arrived_ns = 0;
  TaskKind kind = TaskKind::DETECTION;
  int vehicle = 0;
  double service_s = 0.0;
  double remaining_s = 0.0;
  double lease_hz = 0.0;  ///< rate of the lease asked for; 0: none
};

struct Outage
{
  int64_t begin_ns = 0;
  int64_t end_ns = 0;
  bool silent = false;  ///< connections do not break
};

/// What does not depend on decisions: a function of scenario and seed. Times start at 0. Const methods are thread safe.
class World
{
public:
  /// @param scenario  valid; must outlive this.
  World(const Scenario& scenario, uint32_t seed);

  uint32_t seed() const { return seed_; }
  const Scenario& scenario() const { return scenario_; }
  /// In order of creation; ids are unique among all vehicles and not 0.
  const std::vector<Task>& tasks(size_t vehicle) const { return tasks_[vehicle]; }
  const std::vector<OthersTask>& others(size_t node) const { return others_[node]; }
  const std::vector<Outage>& outages(size_t node) const { return outages_[node]; }
  /// The outage at that time; null: the node is up.
  const Outage* outage(size_t node, int64_t now_ns) const;

  VehicleState vehicle(size_t vehicle, int64_t now_ns) const;
  std::vector<Point> routeAhead(size_t vehicle, int64_t now_ns) const;
  /// Rate of the link; 0 out of range.
  double rate_mbps(size_t vehicle, size_t node, int64_t now_ns) const;

  /// Time from the last sent bit to the arrival, each way. @param key  of the message, unique for vehicle and node
  double uplink_latency_s(size_t vehicle, size_t node, uint64_t key) const;
  double downlink_latency_s(size_t vehicle, size_t node, uint64_t key) const;
  /// Time on a worker.
  double service_s(size_t node, const Task& task) const;
  /// Time on the vehicle at its highest frequency.
  double local_s(const Task& task) const;

private:
  double latency_s(size_t vehicle, size_t node, uint64_t key, uint64_t direction) const;
  double way(size_t vehicle, int64_t now_ns) const;
  void makeTasks(size_t vehicle);
  void makeOthers(size_t node);
  void makeOutages(size_t node);
  void makeShadowing(size_t vehicle, size_t node);

  const Scenario& scenario_;
  const uint32_t seed_;
  LoopRoute route_;
  int64_t end_ns_;
  std::vector<double> starts_;  ///< of each vehicle along the route [m]
  std::vector<std::vector<Task>> tasks_;
  std::vector<std::vector<OthersTask>> others_;
  std::vector<std::vector<Outage>> outages_;
  std::vector<std::vector<float>> shadowing_;  ///< ln of the factor, per vehicle and node, by driven distance
  double shadowing_step_m_;
};

}  // namespace pi_offload::simulation
