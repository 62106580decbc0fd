#pragma once

#include "policies/policy.h"

#include <memory>

namespace pi_offload
{

/// The vehicle's own time and energy for a task.
struct LocalPlan
{
  double time_s = 0.0;  ///< with the backlog
  double energy_j = 0.0;
  double frequency_ghz = 0.0;
};

/// At the highest frequency: as measured or, where it was not, by equations 3 and 4.
LocalPlan localPlan(const DecisionInput& input);
/// At the frequency of least energy that is done by the deadline, with the margin of a fallback.
LocalPlan scaledLocalPlan(const DecisionInput& input, const PolicyOptions& options);
Decision localDecision(const LocalPlan& plan, const DecisionInput& input, const char* reason);

/// Time and energy of a task on a node by what is known of it. What was not measured yet comes from rates and
/// frequency.
struct RemotePlan
{
  double network_s = 0.0;
  double service_s = 0.0;
  double queue_s = 0.0;
  double energy_j = 0.0;  ///< of the radio
  double time_s() const { return network_s + service_s + queue_s; }
};
RemotePlan remotePlan(const DecisionInput& input, const NodeView& node);

/// When the vehicle must begin itself to be done by the deadline, with the margin of the options; the deadline where it
/// is too late for that already, or its backlog takes longer.
double fallbackTimeout(const DecisionInput& input, const PolicyOptions& options);

/// The task is for a node that nobody checks: without an answer the vehicle does it once the deadline is over.
Decision uncheckedDecision(const DecisionInput& input, int node, const char* reason);

std::unique_ptr<Policy> makePaperLiteral(const PolicyOptions& options);
std::unique_ptr<Policy> makePaper(const PolicyOptions& options);
std::unique_ptr<Policy> makeDeadline(const PolicyOptions& options);
std::unique_ptr<Policy> makeExpectedCost(const PolicyOptions& options);

}  // namespace pi_offload
