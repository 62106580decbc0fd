#pragma once

#include <functional>
#include <memory>

#include "policies/policy.h"

namespace pi_offload
{

/// Time and energy of a task on the vehicle.
struct LocalPlan
{
  double time_s = 0.0;  ///< with the backlog
  double energy_j = 0.0;
  double frequency_ghz = 0.0;
};

/// At the highest frequency: as measured, else by equations 3 and 4.
LocalPlan localPlan(const DecisionInput& input);
/// At the frequency of least energy that meets the deadline with the margin of a fallback.
LocalPlan scaledLocalPlan(const DecisionInput& input, const PolicyOptions& options);
Decision localDecision(const LocalPlan& plan, const DecisionInput& input, const char* reason);

/// Expected time and energy of a task on a node; from rates and frequency if nothing was measured.
struct RemotePlan
{
  double network_s = 0.0;
  double service_s = 0.0;
  double queue_s = 0.0;
  double energy_j = 0.0;  ///< of the radio
  double time_s() const { return network_s + service_s + queue_s; }
};
RemotePlan remotePlan(const DecisionInput& input, const NodeView& node);
/// Expected answer time and its mean absolute deviation, the unit of AnswerTimes.
Estimate answerTime(const DecisionInput& input, const NodeView& node, const PolicyOptions& options);

/// A second request, to another node.
struct Hedge
{
  int node = -1;  ///< index; -1: it does not pay
  double energy_j = 0.0;
  double fallback_s = 0.0;  ///< until the vehicle does the task itself
};
/// @param latest_s  of the fallback, from now
/// @param late      probability that the first node does not answer within that time from now
Hedge hedgeOf(const DecisionInput& input, const PolicyOptions& options, double latest_s,
              const std::function<double(double)>& late);

/// Price of a missed deadline [J].
double missCost(const PolicyOptions& options, double eta);

/// The latest time at which the vehicle can begin to meet the deadline, with the margin of the options. The deadline if
/// that time has passed or the backlog takes longer.
double fallbackTimeout(const DecisionInput& input, const PolicyOptions& options);

/// For policies that do not check the node: the vehicle does the task after the deadline if no answer came.
Decision uncheckedDecision(const DecisionInput& input, int node, const char* reason);

std::unique_ptr<Policy> makePaperLiteral(const PolicyOptions& options);
std::unique_ptr<Policy> makePaper(const PolicyOptions& options);
std::unique_ptr<Policy> makeDeadline(const PolicyOptions& options);
std::unique_ptr<Policy> makeExpectedCost(const PolicyOptions& options);

}  // namespace pi_offload
