#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "scheduler/dag_placement.h"

namespace pi_runtime
{

/// InnerCorePolicy::LOOKAHEAD. Keeps its working memory.
class LookaheadMapper
{
public:
  /// Places all nodes of the graph.
  /// @param by_rank  all nodes by falling upward rank, predecessors first.
  void map(const std::vector<uint32_t>& by_rank, DagPlacement* placement);

private:
  void sortChildren(const std::vector<uint32_t>& by_rank, const TaskGraph& graph);
  DagPlacement::Place choose(uint32_t node, DagPlacement* placement);
  double lastChildFinish(uint32_t node, double give_up, DagPlacement* placement);

  std::vector<std::size_t> children_begin_;  // nodes + 1
  std::vector<std::size_t> children_end_;    // grows while the lists are filled
  std::vector<uint32_t> children_;           // successors of node 0, of node 1, ...; each list by falling rank
  std::vector<DagPlacement::Place> tried_;
};

}  // namespace pi_runtime
