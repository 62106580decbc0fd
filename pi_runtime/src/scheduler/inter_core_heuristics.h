#pragma once

#include <pi_runtime/inter_core_scheduler.h>
#include "scheduler/dual_bound.h"
#include "scheduler/inter_core_problem.h"

#include <cstdint>
#include <utility>
#include <vector>

namespace pi_runtime
{

/// The rules that build a mapping task by task: see InterCorePolicy for the rules, InterCoreScheduler for ties. Keeps
/// its memory between calls. Every method overwrites `mapping`.
class InterCoreHeuristics
{
public:
  /// π-Edge, steps (1)-(9). Infinite entries make Div infinite, so tasks that fewer units can run have the larger Div;
  /// among equals the finite entries decide. O(x g + g log g).
  void diffMin(const InterCoreProblem& problem, DiffMinOrder order, uint64_t seed, InterCoreMapping* mapping);
  /// Uses sorted columns: O(x g log g) instead of O(x g^2).
  void minMin(const InterCoreProblem& problem, InterCoreMapping* mapping);
  /// O(x g W), W = 1024.
  void maxMin(const InterCoreProblem& problem, InterCoreMapping* mapping);
  /// O(x g W), W = 1024.
  void sufferage(const InterCoreProblem& problem, InterCoreMapping* mapping);
  /// As sufferage(), but gives up once the prices of the bound show that its objective will not be below `objective`.
  /// Against a good mapping that is after few tasks.
  /// @return false if it gave up; `mapping` is then incomplete.
  bool sufferageBelow(const InterCoreProblem& problem, const DualBound& bound, double objective,
                      InterCoreMapping* mapping);
  void mct(const InterCoreProblem& problem, InterCoreMapping* mapping);
  void met(const InterCoreProblem& problem, InterCoreMapping* mapping);
  void olb(const InterCoreProblem& problem, InterCoreMapping* mapping);
  void heftRank(const InterCoreProblem& problem, InterCoreMapping* mapping);
  /// Tasks by falling smallest weight, each to its smallest completion. Not a policy, but a good start of a search.
  void longestFirst(const InterCoreProblem& problem, InterCoreMapping* mapping);

private:
  enum class DynamicRank
  {
    COMPLETION,
    SUFFERAGE,
  };
  /// Smallest and second smallest completion of a task.
  struct Prospect
  {
    uint32_t task;
    uint32_t unit;
    uint32_t second_unit;
    double completion;
    double second_completion;
  };
  struct DiffMinKey
  {
    uint32_t task;
    uint32_t infeasible_units;
    double div;
    double sub;
    uint64_t draw;
  };

  static Prospect prospect(const InterCoreProblem& problem, uint32_t task, const std::vector<double>& load);
  static double rank(const Prospect& prospect, DynamicRank by);
  /// Maps the tasks of ranked_ in their order, each to its smallest completion.
  void mapRanked(const InterCoreProblem& problem, InterCoreMapping* mapping);
  /// Sorts ranked_ by falling first member, equals by task.
  void sortRanked();
  /// @param bound nullptr: never gives up.
  bool mapByDynamicRank(const InterCoreProblem& problem, DynamicRank by, const DualBound* bound, double objective,
                        InterCoreMapping* mapping);

  std::vector<DiffMinKey> keys_;
  std::vector<std::pair<double, uint32_t>> ranked_;
  std::vector<std::pair<double, uint32_t>> columns_;  ///< of minMin(): weight and task, sorted within each unit
  std::vector<size_t> heads_;
  std::vector<size_t> ends_;
  std::vector<bool> mapped_;
  std::vector<Prospect> window_;
};

}  // namespace pi_runtime
