#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "engine/node.h"
#include "policies/answer_times.h"
#include "policies/cost_model.h"

namespace pi_offload
{

/// Mean and deviation of a quantity.
struct Estimate
{
  double mean = 0.0;
  double deviation = 0.0;  ///< mean absolute deviation
};

/// What is known about a node when a task is decided.
struct NodeView
{
  std::string id;
  bool connected = false;  ///< it answered recently, is not draining, and serves this kind
  double distance_m = 0.0;
  double range_m = 0.0;
  double residence_s = 0.0;          ///< along the route if it is known; 0 out of range
  double printed_residence_s = 0.0;  ///< printedResidence(), for paper_literal
  double capacity_gcycles = 0.0;     ///< w_i
  double frequency_ghz = 0.0;        ///< f_off
  double uplink_mbps = 0.0;          ///< r
  double downlink_mbps = 0.0;
  Estimate network_s;          ///< for this task's data, both ways
  double network_age_s = 0.0;  ///< age of the measured rate
  Estimate service_s;
  Estimate queue_s;                    ///< advertised, corrected for its age
  double refused_share = 0.0;          ///< of recent tasks: refused or dropped by the node
  bool lost = false;                   ///< tasks there cost more than on the vehicle lately
  const AnswerTimes* times = nullptr;  ///< of its answers; null: Laplace
};

/// A task to decide.
struct DecisionInput
{
  TaskKind kind = TaskKind::DETECTION;
  TaskNeeds needs;
  LocalComputer computer;
  Radio radio;
  double eta = 0.5;              ///< weight of time in [0, 1]
  double local_backlog_s = 0.0;  ///< wait of a task on the vehicle
  double local_need_s = 0.0;     ///< time before the deadline at which a fallback must begin; 0: by fallback_factor
  double local_s = 0.0;          ///< measured t_L; 0: use equation 3
  double local_j = 0.0;          ///< measured e_L; 0: use equation 4
  int previous_node = -1;        ///< of the last task of this kind; -1: the vehicle
  std::vector<NodeView> nodes;
};

struct Decision
{
  int node = -1;            ///< index into DecisionInput::nodes; -1: the vehicle
  double expected_s = 0.0;  ///< time to the result
  double expected_j = 0.0;
  double expected_misses = 0.0;  ///< probability that the deadline is missed
  /// When the vehicle does the task itself, if no answer came; 0 for a task of the vehicle. It is the latest time at
  /// which the vehicle can meet the deadline. It is the deadline if the vehicle cannot, and for policies without
  /// fallback (nearest*, paper_literal).
  double timeout_s = 0.0;
  /// When another node is asked too, if no answer came and the budget allows; 0: never.
  double hedge_s = 0.0;
  double frequency_ghz = 0.0;  ///< of the vehicle's computer for this task; a fallback runs at the highest
  size_t looked_at = 0;        ///< visits to nodes; figure 12 as printed: (M - 1)^2
  const char* reason = "";     ///< a few words, static
};

struct PolicyOptions
{
  double miss_cost_j = 20.0;  ///< lambda: price of a missed deadline at eta 0.5 [J]
  double deviations = 4.0;    ///< k: t + k deviations must fit into the residence, for `deadline` into the deadline too
  double residence_share = 0.8;          ///< part of the residence for a task
  double hysteresis = 0.02;              ///< another place must be better by this part
  double fallback_factor = 1.1;          ///< the fallback starts local_s times this before the deadline
  double needed_capacity_gcycles = 0.0;  ///< W of the paper
  bool scale_frequency = false;          ///< local, deadline, expected_cost: work at bestLocalFrequency()
  double least_deviation_s = 0.002;      ///< least deviation of a response time
  double loss_share = 0.002;             ///< requests that stay without an answer in time
  double fallback_miss_share = 0.0005;   ///< fallbacks that start in time and still miss
  double curiosity_s = 0.05;             ///< a node whose rate is older may get a task to measure the rate
  double hedge_share = 0.1;              ///< part of the radio's energy for second requests at most; 0: none
  double lost_j = 8.0;  ///< a node whose tasks cost so much more than the vehicle's rests [J]; 0: never

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Decides where a task is done. Not thread safe. decide() does not allocate, see makePolicy().
class Policy
{
public:
  virtual ~Policy() = default;
  virtual const char* name() const = 0;
  virtual Decision decide(const DecisionInput& input) = 0;
};

/// @param name  one of policyNames():
///   - local: never offloads.
///   - nearest: the nearest node in range, connected or not, else local.
///   - nearest_anywhere: the nearest node, also out of range.
///   - paper_literal: figure 12 as printed, with its twelve defects (docs/design/offload.md).
///   - paper: figure 12 repaired: the cheapest node in range that meets residence and deadline.
///   - deadline: least energy among nodes that meet t + k deviations <= min(deadline, part of the residence).
///   - expected_cost: least expected energy + fallback energy + lambda * P(miss), with leases and hysteresis; lambda is
///     miss_cost_j * eta / (1 - eta), with the quotient kept within [0.1, 10].
/// The time of decide() grows with the number of nodes, for paper_literal with its square. paper_literal allocates for
/// more than 1024 nodes.
/// @throws std::invalid_argument for options, or naming the known policies.
std::unique_ptr<Policy> makePolicy(const std::string& name, const PolicyOptions& options);
const std::vector<std::string>& policyNames();

}  // namespace pi_offload
