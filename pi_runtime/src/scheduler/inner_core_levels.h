#pragma once

#include <cstdint>
#include <vector>

#include "scheduler/dag_placement.h"
#include <pi_runtime/inner_core_scheduler.h>

namespace pi_runtime
{

/// InnerCorePolicy::LEVELS. Keeps its working memory.
class LevelMapper
{
public:
  /// Places all nodes of the graph.
  /// @param by_rank  all nodes by falling upward rank, predecessors first.
  void map(const std::vector<uint32_t>& by_rank, LevelMapping mapping, bool barrier, DagPlacement* placement);

private:
  struct Candidate
  {
    uint32_t node;
    uint32_t infeasible_units = 0;
    double div = 0.0;
    double sub = 0.0;
    DagPlacement::Place best = {};
  };

  void sortByDifference(const EtcMatrix& etc);
  double mapInOrder(DagPlacement* placement);
  double mapMinMin(DagPlacement* placement);

  std::vector<std::vector<uint32_t>> levels_;  // nodes per level, each by falling rank
  std::vector<Candidate> candidates_;
};

}  // namespace pi_runtime
