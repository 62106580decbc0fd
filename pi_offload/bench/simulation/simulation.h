#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "engine/offload_engine.h"
#include "server/admission.h"

namespace pi_offload
{

/// A world for the simulator. config/scenarios/ has examples; README.md explains all keys.
struct Scenario
{
  std::string name;
  double duration_s = 600.0;   ///< time during which tasks arrive; all of them are finished
  int vehicles = 1;            ///< equal ones, at random places of the route
  std::vector<Point> route;    ///< closed loop [m], at least two points
  double speed = 3.0;          ///< [m/s], 0: they stand
  EngineOptions engine;        ///< needs come from the streams; policy_name is not used
  AdmissionOptions admission;  ///< of the nodes; `workers` is not used

  /// Tasks of a vehicle; at most one stream of each kind.
  struct Stream
  {
    TaskKind kind = TaskKind::DETECTION;
    double rate_hz = 10.0;
    bool regular = true;  ///< false: Poisson
    double deadline_s = 0.2;
    double work_gcycles = 0.171;    ///< w, for policies that use cycles
    double local_s = 0.09;          ///< t_L, mean
    double local_deviation = 0.05;  ///< standard deviation of its logarithm
    double local_j = 0.42;          ///< e_L, mean, at the computer's highest frequency
    size_t input_bytes = 60000;
    size_t output_bytes = 1000;
  };
  std::vector<Stream> streams;

  struct Node
  {
    NodeDescription description;
    int workers = 2;
    std::array<double, TASK_KINDS> service_s{0.02, 0.15};  ///< mean
    double service_deviation = 0.1;                        ///< standard deviation of the logarithm
    double slow_share = 0.0;                               ///< part of the tasks that take slow_factor as long
    double slow_factor = 10.0;
  };
  std::vector<Node> nodes;

  /// The logarithm of the rate falls linearly from the node to the edge of the range. Log-normal shadowing has an
  /// exponential autocorrelation over the driven distance. A vehicle sends one message at a time and drops one that
  /// cannot begin before its deadline. Out of range nothing arrives, and the radio transmits until the deadline.
  struct Network
  {
    double rate_near_mbps = 40.0;
    double rate_edge_mbps = 6.0;
    double shadowing_db = 4.0;          ///< standard deviation of the rate
    double correlation_m = 10.0;        ///< of driving
    double round_trip_s = 0.008;        ///< of an empty message, mean
    double round_trip_deviation = 0.3;  ///< standard deviation of the logarithm
    double loss = 0.002;                ///< part of messages that need a retransmission
    double retransmission_s = 0.2;
  } network;

  /// Tasks of other vehicles at each node: Poisson arrivals of both kinds with the mean service time `task_s`. Bursts
  /// have exponential lengths.
  struct Load
  {
    double base_load = 0.05;   ///< part of the workers' time outside of bursts
    double heavy_share = 0.0;  ///< part of the time in bursts
    double heavy_load = 1.2;   ///< part of the workers' time in bursts
    double mean_burst_s = 3.0;
    double task_s = 0.05;    ///< mean service time; between those of both kinds
    double time_left = 0.6;  ///< part of the deadline left at arrival
    int vehicles = 20;       ///< senders of the tasks
    bool leases = true;      ///< each asks for a lease for its part of the load
  } load;

  /// Half of the failures break connections at once (the process ends), half are silent.
  struct Failures
  {
    double mean_between_s = 0.0;  ///< per node, exponential; 0: none
    double mean_repair_s = 20.0;  ///< exponential
  } failures;

  const Stream* stream(TaskKind kind) const;  ///< null: there is none

  /// @throws std::runtime_error naming file, key, value and bound.
  static Scenario load_file(const std::string& path);
  /// @throws std::invalid_argument naming key, value and bound.
  void validate() const;
};

struct SimulationResult
{
  struct OfKind
  {
    uint64_t tasks = 0;
    uint64_t missed = 0;
    uint64_t local = 0;        ///< decided for the vehicle
    uint64_t remote = 0;       ///< answered by a node
    uint64_t remote_late = 0;  ///< of these, after the deadline
    uint64_t fallback = 0;     ///< decided for a node, done by the vehicle
    double p50_s = 0.0;        ///< response time of all tasks; infinite without a result
    double p99_s = 0.0;
    /// Part of the tasks that a node did not answer in time: a vehicle without fallback would miss them.
    double unanswered_share() const
    {
      return tasks > 0 ? static_cast<double>(fallback + remote_late) / static_cast<double>(tasks) : 0.0;
    }
    double miss_share() const { return tasks > 0 ? static_cast<double>(missed) / static_cast<double>(tasks) : 0.0; }
  };
  std::array<OfKind, TASK_KINDS> of_kind;
  double task_seconds = 0.0;    ///< duration times vehicles
  double power_w = 0.0;         ///< of the tasks and probes, per vehicle
  double local_w = 0.0;         ///< of it: tasks decided for the vehicle
  double fallback_w = 0.0;      ///< of it: the vehicle's computer for fallbacks
  double radio_w = 0.0;         ///< of it: the radio
  double oracle_power_w = 0.0;  ///< in the same world; 0: not compared
  uint64_t oracle_missed = 0;
  uint64_t handovers = 0;                ///< changes of the node between tasks of a kind at nodes
  uint64_t refused = 0;                  ///< tasks refused at arrival
  uint64_t expired = 0;                  ///< tasks taken and dropped because their time was over
  uint64_t timeouts = 0;                 ///< tasks that ended without an answer or refusal of their node
  uint64_t served = 0;                   ///< results of nodes in time
  double busy_share = 0.0;               ///< of the workers' time, with tasks of others
  std::vector<double> tasks_of_vehicle;  ///< served in time by nodes
  std::map<std::string, uint64_t> fallback_reasons;
  std::map<std::string, uint64_t> miss_reasons;

  uint64_t missed() const;
  /// Relative excess of power over the oracle; 0 if not compared.
  double regret() const { return oracle_power_w > 0.0 ? power_w / oracle_power_w - 1.0 : 0.0; }
  /// The same for power + miss_cost_j per missed deadline.
  double regret(double miss_cost_j) const;
  /// Jain's index of tasks_of_vehicle: 1 if all are equal, 1/n if one vehicle gets all; 1 if none gets any.
  double fairness() const;
};

/// Runs OffloadEngine and Admission, as on vehicle and node, in simulated time. The world (tasks, network, load,
/// failures) depends only on scenario and seed. Thread safe; the same arguments give the same result.
///
/// Energy is that of the world, not the engine's estimate: of the radio (transmitting, receiving, waiting) and of the
/// computer, also for late results.
/// @param policy  one of policyNames(), or "oracle". For each task the oracle tries all choices on a copy of the world
///   and takes the one of least energy that meets the deadline, else the vehicle. It knows the network, the coming load
///   of others, and failures. It does not know later tasks of the vehicles, so it is not a strict lower bound where the
///   vehicles themselves fill the nodes.
/// @throws std::invalid_argument for scenario or policy.
SimulationResult simulate(const Scenario& scenario, const std::string& policy, uint32_t seed);

/// @param oracle  simulate() with policy "oracle" for the same scenario and seed
void compareWithOracle(const SimulationResult& oracle, SimulationResult* result);

}  // namespace pi_offload
