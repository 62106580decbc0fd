#pragma once

#include "policies/cost_model.h"
#include "engine/node.h"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace pi_offload
{

/// A mean and how much values deviate from it.
struct Estimate
{
  double mean = 0.0;
  double deviation = 0.0;  ///< mean absolute deviation
};

/// All that is known of a node when a task is decided.
struct NodeView
{
  std::string id;
  bool connected = false;  ///< it answered lately and is not draining, and serves this kind of task
  double distance_m = 0.0;
  double range_m = 0.0;
  double residence_s = 0.0;          ///< usable now, along the route where it is known; 0 out of range
  double printed_residence_s = 0.0;  ///< printedResidence(), for paper_literal
  double capacity_gcycles = 0.0;     ///< w_i
  double frequency_ghz = 0.0;        ///< f_off
  double uplink_mbps = 0.0;          ///< r
  double downlink_mbps = 0.0;
  Estimate network_s;          ///< both ways, of this task's data
  double network_age_s = 0.0;  ///< since its rate was measured
  Estimate service_s;
  Estimate queue_s;            ///< advertised, corrected for its age
  double load_age_s = 0.0;     ///< age of the advertisement
  double refused_share = 0.0;  ///< of the tasks sent there lately: refused or dropped by the node
  bool leased = false;         ///< the vehicle's lease is for one more task of this kind
};

/// A task to decide.
struct DecisionInput
{
  TaskKind kind = TaskKind::DETECTION;
  TaskNeeds needs;
  LocalComputer computer;
  Radio radio;
  double eta = 0.5;              ///< weight of time in [0, 1]
  double local_backlog_s = 0.0;  ///< until the vehicle itself can begin
  double local_s = 0.0;          ///< t_L as measured; 0: equation 3
  double local_j = 0.0;          ///< e_L as measured; 0: equation 4
  int previous_node = -1;        ///< where the last task of this kind went; -1: the vehicle
  std::vector<NodeView> nodes;
};

struct Decision
{
  int node = -1;            ///< index into DecisionInput::nodes; -1: the vehicle
  double expected_s = 0.0;  ///< until the result is there
  double expected_j = 0.0;
  double expected_misses = 0.0;  ///< probability that the deadline is missed
  /// After which the vehicle does it itself; 0 for the vehicle. The latest time that lets it meet the deadline,
  /// whatever its backlog was; the deadline where it could not, and of policies without fallback (nearest*,
  /// paper_literal).
  double timeout_s = 0.0;
  double frequency_ghz = 0.0;  ///< of the vehicle's computer, where it does the task; a fallback runs at the highest
  size_t looked_at = 0;        ///< nodes, each as often as it was; figure 12 as printed: (M - 1)^2
  const char* reason = "";     ///< a few words, static
};

struct PolicyOptions
{
  double miss_cost_j = 20.0;     ///< lambda: what a missed deadline costs at eta 0.5 [J]
  double deviations = 4.0;       ///< k: t + k deviations must be within the residence, for `deadline` the deadline too
  double residence_share = 0.8;  ///< a task must be done within this share of the residence
  double hysteresis = 0.1;       ///< another place must be better by this share
  double fallback_factor = 1.1;  ///< local fallback starts local_s times this before the deadline
  double needed_capacity_gcycles = 0.0;  ///< W of the paper
  bool scale_frequency = false;          ///< local, deadline, expected_cost: the vehicle works at bestLocalFrequency()
  double tail_scale = 1.0;               ///< how much wider response times are than their deviations say
  double least_deviation_s = 0.002;      ///< a response time is not known better than this
  double loss_share = 0.002;             ///< requests without an answer in time, whatever the deviations say
  double fallback_miss_share = 0.005;    ///< fallbacks that miss the deadline though they begin in time
  double unleased_tasks = 1.0;           ///< without a lease the queue deviates by so many service times more
  double curiosity_s = 0.2;  ///< where the rate was not measured for so long, a task may go there to measure it
  double load_growth = 0.1;  ///< the queue deviates by so much more per second of age of what is known [s/s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Decides where a task is done. Not thread safe; decides without allocating.
class Policy
{
public:
  virtual ~Policy() = default;
  virtual const char* name() const = 0;
  virtual Decision decide(const DecisionInput& input) = 0;
};

/// @param name  one of policyNames():
///   - local: never offloads. nearest: to the nearest node in range, connected or not, else local.
///   - nearest_anywhere: the same without looking at the range.
///   - paper_literal: figure 12 as printed, with its twelve defects (docs/design/offload.md).
///   - paper: figure 12 repaired: the cheapest node in range, in time for residence and deadline, by its own figures.
///   - deadline: least energy among nodes that meet t + k deviations <= min(deadline, share of the residence).
///   - expected_cost: least expected energy + fallback energy + lambda * P(miss), with leases and hysteresis; lambda is
///     miss_cost_j * eta / (1 - eta), where the quotient is kept within [0.1, 10].
/// decide() takes time that grows with the number of nodes, paper_literal with its square. It allocates nothing but, in
/// paper_literal, for more than 1024 nodes at once.
/// @throws std::invalid_argument naming the name and those that there are; or for options.
std::unique_ptr<Policy> makePolicy(const std::string& name, const PolicyOptions& options);
const std::vector<std::string>& policyNames();

}  // namespace pi_offload
