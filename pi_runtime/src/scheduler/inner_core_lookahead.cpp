#include "scheduler/inner_core_lookahead.h"

#include <algorithm>
#include <limits>

namespace pi_runtime
{

void LookaheadMapper::map(const std::vector<uint32_t>& by_rank, DagPlacement* placement)
{
  sortChildren(by_rank, placement->graph());
  for (const uint32_t node : by_rank)
  {
    placement->commit(node, choose(node, placement));
  }
}

void LookaheadMapper::sortChildren(const std::vector<uint32_t>& by_rank, const TaskGraph& graph)
{
  children_begin_.assign(graph.nodes() + std::size_t{1}, 0);
  for (uint32_t node = 0; node < graph.nodes(); ++node)
  {
    children_begin_[node + std::size_t{1}] = children_begin_[node] + graph.successors(node).size();
  }
  children_end_ = children_begin_;
  children_.resize(graph.edges());
  for (const uint32_t node : by_rank)
  {
    for (const TaskGraph::Link& predecessor : graph.predecessors(node))
    {
      children_[children_end_[predecessor.node]++] = node;
    }
  }
}

/// The unit from which the last child finishes first; of equal ones that where the node itself finishes first.
DagPlacement::Place LookaheadMapper::choose(uint32_t node, DagPlacement* placement)
{
  if (children_begin_[node] == children_end_[node])
  {
    return placement->earliest(node);
  }
  constexpr double INFINITE = std::numeric_limits<double>::infinity();
  DagPlacement::Place best{0, {0.0, INFINITE, {}, 0}};
  double best_child = INFINITE;
  for (uint32_t unit = 0; unit < placement->units(); ++unit)
  {
    const DagPlacement::Place place = placement->earliest(node, unit);
    if (place.finish() == INFINITE)
    {
      continue;
    }
    placement->commit(node, place);
    const double child = lastChildFinish(node, best_child, placement);
    placement->undo(node, place);
    if (child < best_child || (child == best_child && place.finish() < best.finish()))
    {
      best = place;
      best_child = child;
    }
  }
  return best;
}

/// Latest finish of the children of a placed node, were they placed next as HEFT would; predecessors of theirs that are
/// not yet placed do not count. Gives up, with any larger value, once `give_up` is exceeded.
double LookaheadMapper::lastChildFinish(uint32_t node, double give_up, DagPlacement* placement)
{
  const uint32_t* child = children_.data() + children_begin_[node];
  const uint32_t* const end = children_.data() + children_end_[node];
  double last = 0.0;
  tried_.clear();
  for (; child != end && last <= give_up; ++child)
  {
    tried_.push_back(placement->earliest(*child));
    placement->commit(*child, tried_.back());
    last = std::max(last, tried_.back().finish());
  }
  for (; !tried_.empty(); tried_.pop_back())
  {
    placement->undo(*--child, tried_.back());
  }
  return last;
}

}  // namespace pi_runtime
