#pragma once

#include "policies/admission.h"
#include "engine/offload_engine.h"

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace pi_offload
{

/// A world for the simulator; YAML in config/scenarios/, all keys in pi_offload/README.md.
struct Scenario
{
  std::string name;
  double duration_s = 600.0;   ///< tasks come for so long; all of them are brought to their end
  int vehicles = 1;            ///< alike, at random places of the route
  std::vector<Point> route;    ///< closed loop [m], at least two points
  double speed = 3.0;          ///< [m/s], 0: they stand
  EngineOptions engine;        ///< computer, radio, needs (from the streams), deadlines; the policy's name is not used
  AdmissionOptions admission;  ///< of the nodes; each one has its own number of workers

  /// Tasks of a vehicle; at most one stream of each kind.
  struct Stream
  {
    TaskKind kind = TaskKind::DETECTION;
    double rate_hz = 10.0;
    bool regular = true;  ///< false: Poisson
    double deadline_s = 0.2;
    double work_gcycles = 0.171;    ///< w, for policies that reckon by cycles
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
  };
  std::vector<Node> nodes;

  /// Uplink: the rate at the node falls to that at the edge of the range, its logarithm in proportion to the distance;
  /// log-normal shadowing with a correlation distance (exponential autocorrelation). A vehicle's messages go out one
  /// after the other; one that cannot begin before its deadline is thrown away. Out of range nothing arrives, and the
  /// radio tries until the deadline.
  struct Network
  {
    double rate_near_mbps = 40.0;
    double rate_edge_mbps = 6.0;
    double shadowing_db = 4.0;          ///< standard deviation of the rate
    double correlation_m = 10.0;        ///< of the way driven
    double round_trip_s = 0.008;        ///< of an empty message, mean
    double round_trip_deviation = 0.3;  ///< standard deviation of the logarithm
    double loss = 0.002;                ///< share of messages that take a retransmission
    double retransmission_s = 0.2;
  } network;

  /// Tasks of others, at each node: Poisson, of both kinds, mixed so that the mean service time is `task_s`. Bursts
  /// last exponentially long.
  struct Load
  {
    double base_load = 0.05;   ///< part of the workers' time, out of bursts
    double heavy_share = 0.0;  ///< part of the time in bursts
    double heavy_load = 1.2;   ///< part of the workers' time asked for in bursts
    double mean_burst_s = 3.0;
    double task_s = 0.05;    ///< mean service time; within the node's of both kinds
    double time_left = 0.6;  ///< share of their deadline that is left when they arrive
    int vehicles = 20;       ///< that they come from
    bool leases = true;      ///< they ask for leases, each for its part of the present load
  } load;

  /// Half of the failures are a process that ends (connections break at once), half are silent.
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
    uint64_t local = 0;        ///< decided so
    uint64_t remote = 0;       ///< answered by a node
    uint64_t remote_late = 0;  ///< of these, after the deadline
    uint64_t fallback = 0;     ///< decided for a node, done by the vehicle
    double p50_s = 0.0;        ///< until the result, of all tasks; a task without one counts as infinite
    double p99_s = 0.0;
    /// Tasks that a vehicle without fallback would have missed: given to a node and not answered in time.
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
  double oracle_power_w = 0.0;  ///< of the oracle in the same world; 0: not compared
  uint64_t oracle_missed = 0;
  uint64_t handovers = 0;   ///< the node of a task is another one than that of the kind's last task that had one
  uint64_t refused = 0;     ///< tasks that a node refused when they came
  uint64_t expired = 0;     ///< tasks that a node took and dropped, their time being over
  uint64_t timeouts = 0;    ///< tasks sent that were not answered (also not by a refusal) when they ended
  uint64_t served = 0;      ///< results of nodes that came in time
  double busy_share = 0.0;  ///< of the nodes' workers, with the others' tasks
  std::vector<double> tasks_of_vehicle;  ///< served remotely and in time, for the fairness index
  std::map<std::string, uint64_t> fallback_reasons;
  std::map<std::string, uint64_t> miss_reasons;

  uint64_t missed() const;
  /// More power than the oracle, as a share; 0 if not compared.
  double regret() const { return oracle_power_w > 0.0 ? power_w / oracle_power_w - 1.0 : 0.0; }
  /// The same of power + miss_cost_j per missed deadline.
  double regret(double miss_cost_j) const;
  /// Jain's index of tasks_of_vehicle: 1 if all get the same, 1/n if one gets all; 1 if nobody gets anything.
  double fairness() const;
};

/// One run: the same OffloadEngine and Admission as on vehicle and node, in simulated time. The world (tasks, network,
/// load, failures) depends on scenario and seed alone, not on the policy. Thread safe; the same arguments give the same
/// result.
///
/// Energy is what the world took, not what the engine believes: radio times of what was sent (transmitting, receiving,
/// waiting until the answer or the task's end), the computer's time, also for work whose result came too late.
/// @param policy  one of policyNames(), or "oracle": for each task it tries all choices on a copy of the world and
///   takes the one of least energy that meets the deadline, else the vehicle. It knows the network, the others' load
///   to come, and failures; it does not foresee the vehicles' own later tasks: what its choice does to their queue and
///   uplink, and what theirs do to it. So it is no lower bound in the strict sense where vehicles fill the nodes by
///   themselves.
/// @throws std::invalid_argument for scenario or policy.
SimulationResult simulate(const Scenario& scenario, const std::string& policy, uint32_t seed);

/// @param oracle  simulate(scenario, "oracle", seed) of the same scenario and seed
void compareWithOracle(const SimulationResult& oracle, SimulationResult* result);

}  // namespace pi_offload
