#pragma once

#include <pi_runtime/dag_plan.h>
#include <pi_runtime/inner_core_scheduler.h>

#include <optional>
#include <string>

namespace pi_runtime
{

/// Checks a plan against its problem, with a tolerance of 1e-9 of the makespan for rounding: every node runs for its
/// time on a unit that can run it, not before its release, the unit's available time and the arrival of its
/// predecessors' data; no unit runs two nodes at a time; order, level, infeasible and makespan agree with the rest.
/// @param barrier  also demand that no node starts before all nodes of the levels above it have finished.
/// @return the first violation; nothing if the plan is valid.
std::optional<std::string> validatePlan(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                                        const DagPlan& plan, const StartTimes& start_times = StartTimes(),
                                        bool barrier = false);

/// Communication to computation ratio: mean transfer time of an edge (over all pairs of different units) divided by the
/// mean time of a node (over the units that can run it). 0 without edges or with one unit.
double communicationToComputation(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers);

/// LOOKAHEAD where communicationToComputation() >= 1, else HEFT.
InnerCorePolicy recommendedPolicy(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers);

}  // namespace pi_runtime
