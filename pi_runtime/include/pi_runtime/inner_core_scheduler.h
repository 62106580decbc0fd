#pragma once

#include <memory>
#include <string>

#include <pi_runtime/dag_plan.h>
#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/task_graph.h>
#include <pi_runtime/transfer_model.h>

namespace pi_runtime
{

/// How the inner-core scheduler plans sub-tasks that depend on each other.
enum class InnerCorePolicy
{
  /// π-Edge, section IV.C, as printed: the graph is cut into levels of independent nodes. Min-Min or Diff-Min maps each
  /// level. A level begins when all nodes above it are done. For comparison only: this barrier costs 1-30 %.
  LEVELS,
  /// Topcuoglu, Hariri, Wu 2002, "Performance-effective and low-complexity task scheduling for heterogeneous
  /// computing": nodes by falling upward rank, each on the unit where it finishes first.
  HEFT,
  /// Bittencourt, Sakellariou, Madeira 2010, "DAG scheduling using a lookahead variant of the heterogeneous earliest
  /// finish time algorithm": as HEFT, but each node goes where the last of its successors would finish first. Planning
  /// takes 2 to 7 times as long. Better than HEFT where transfers take at least as long as the work.
  LOOKAHEAD,
};

/// How InnerCorePolicy::LEVELS maps the nodes of one level.
enum class LevelMapping
{
  RANK,      ///< by falling upward rank, each where it finishes first
  MIN_MIN,   ///< always the pair of node and unit with the earliest finish of all
  DIFF_MIN,  ///< by falling Div = largest over smallest time, then Sub = their difference, each where it finishes first
};

/// "levels", "heft", "lookahead".
const char* toString(InnerCorePolicy policy);
/// "rank", "min_min", "diff_min".
const char* toString(LevelMapping mapping);
/// The inverse of toString. @throws std::invalid_argument  names the text and what is known.
InnerCorePolicy parseInnerCorePolicy(const std::string& text);
LevelMapping parseLevelMapping(const std::string& text);

struct InnerCoreOptions
{
  InnerCorePolicy policy = InnerCorePolicy::HEFT;
  bool insertion = true;  ///< a node may go between two nodes planned before it, as in the HEFT paper

  // For LEVELS only.
  LevelMapping level_mapping = LevelMapping::MIN_MIN;  ///< the one the paper names first
  bool level_barrier = true;                           ///< as the paper; false: a node waits for its predecessors only
};

/// Plans task graphs. Keeps its working memory between plans to save allocations. Not thread safe.
///
/// Deterministic. Ties go to the node that comes first in TaskGraph::topologicalOrder() and to the unit with the
/// smallest number. Diff-Min breaks ties by the larger upward rank (π-Edge: at random), since its own key is the same
/// for all nodes if the units are alike.
class InnerCoreScheduler
{
public:
  explicit InnerCoreScheduler(const InnerCoreOptions& options = InnerCoreOptions());
  ~InnerCoreScheduler();
  InnerCoreScheduler(InnerCoreScheduler&&) noexcept;
  InnerCoreScheduler& operator=(InnerCoreScheduler&&) noexcept;

  const InnerCoreOptions& options() const { return options_; }

  /// @param etc        time of each node on each unit [s]; +infinity: the unit cannot run it. If no unit can run a
  /// node,
  ///                   the plan is infeasible; this is a result, not an error.
  /// @param transfers  between the units of `etc`.
  /// @param plan       overwritten; its memory is used again.
  /// @throws std::invalid_argument  sizes do not agree, no units, a time in `etc` that is not > 0, or a start time that
  ///                                is negative or not finite; `plan` is then untouched. Also if times or transfers are
  ///                                so long that they add up to infinity; `plan` is then not usable.
  void schedule(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                const StartTimes& start_times, DagPlan* plan);

  DagPlan schedule(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                   const StartTimes& start_times = StartTimes());

private:
  struct Workspace;

  InnerCoreOptions options_;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace pi_runtime
