#pragma once

#include "simulation/loop_route.h"

#include "simulation/simulation.h"

#include <cmath>

namespace pi_offload::simulation
{

constexpr double NS_PER_S = 1e9;
inline int64_t toNs(double seconds)
{
  return static_cast<int64_t>(std::llround(seconds * NS_PER_S));
}
inline double toS(int64_t ns)
{
  return static_cast<double>(ns) / NS_PER_S;
}

/// A task that somebody else gives to a node.
struct OthersTask
{
  int64_t arrived_ns = 0;
  TaskKind kind = TaskKind::DETECTION;
  int vehicle = 0;
  double service_s = 0.0;
  double remaining_s = 0.0;
  double lease_hz = 0.0;  ///< that its vehicle asks for; 0: none
};

struct Outage
{
  int64_t begin_ns = 0;
  int64_t end_ns = 0;
  bool silent = false;  ///< nobody is told
};

/// All that does not depend on what vehicles decide; a function of scenario and seed. Instants from 0, the start. Const
/// methods are thread safe.
class World
{
public:
  /// @param scenario  valid; must outlive this.
  World(const Scenario& scenario, uint32_t seed);

  const Scenario& scenario() const { return scenario_; }
  /// In order of creation; ids are unique among all vehicles and not 0.
  const std::vector<Task>& tasks(size_t vehicle) const { return tasks_[vehicle]; }
  const std::vector<OthersTask>& others(size_t node) const { return others_[node]; }
  const std::vector<Outage>& outages(size_t node) const { return outages_[node]; }
  /// The one of the outage at that instant; null: the node is up.
  const Outage* outage(size_t node, int64_t now_ns) const;

  VehicleState vehicle(size_t vehicle, int64_t now_ns) const;
  std::vector<Point> routeAhead(size_t vehicle, int64_t now_ns) const;
  /// Of the link; 0 out of range.
  double rate_mbps(size_t vehicle, size_t node, int64_t now_ns) const;

  /// From the last bit sent to the message's arrival, and likewise back. @param key  of the message, unique for vehicle
  /// and node
  double uplink_latency_s(size_t vehicle, size_t node, uint64_t key) const;
  double downlink_latency_s(size_t vehicle, size_t node, uint64_t key) const;
  /// On a worker.
  double service_s(size_t node, const Task& task) const;
  /// On the vehicle, at its highest frequency.
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
  std::vector<std::vector<float>> shadowing_;  ///< ln of the factor, per vehicle and node, by way driven
  double shadowing_step_m_;
};

}  // namespace pi_offload::simulation
