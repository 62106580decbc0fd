#include "scheduler/inner_core_levels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace pi_runtime
{

void LevelMapper::map(const std::vector<uint32_t>& by_rank, LevelMapping mapping, bool barrier, DagPlacement* placement)
{
  const TaskGraph& graph = placement->graph();
  levels_.resize(graph.levels());
  for (std::vector<uint32_t>& level : levels_)
  {
    level.clear();
  }
  for (const uint32_t node : by_rank)
  {
    levels_[graph.level(node)].push_back(node);
  }
  double finish = 0.0;
  for (const std::vector<uint32_t>& level : levels_)
  {
    if (barrier)
    {
      placement->setBarrier(finish);
    }
    candidates_.clear();
    for (const uint32_t node : level)
    {
      candidates_.push_back({node});
    }
    if (mapping == LevelMapping::DIFF_MIN)
    {
      sortByDifference(placement->etc());
    }
    finish = std::max(finish, mapping == LevelMapping::MIN_MIN ? mapMinMin(placement) : mapInOrder(placement));
  }
}

/// π-Edge, section IV.B, steps (5) and (6): the largest Div first, of equal ones the largest Sub. A unit that cannot
/// run the node makes both infinite, so nodes that fewer units can run go first; among these the other units decide.
/// What is equal after that stays in the order of upward rank.
void LevelMapper::sortByDifference(const EtcMatrix& etc)
{
  for (Candidate& candidate : candidates_)
  {
    double smallest = std::numeric_limits<double>::infinity();
    double largest = 0.0;
    for (std::size_t unit = 0; unit < etc.units(); ++unit)
    {
      const double time = etc.at(candidate.node, unit);
      if (std::isfinite(time))
      {
        smallest = std::min(smallest, time);
        largest = std::max(largest, time);
      }
      else
      {
        ++candidate.infeasible_units;
      }
    }
    candidate.div = largest / smallest;
    candidate.sub = largest - smallest;
  }
  const auto key = [](const Candidate& candidate)
  { return std::tie(candidate.infeasible_units, candidate.div, candidate.sub); };
  std::stable_sort(candidates_.begin(), candidates_.end(),
                   [&key](const Candidate& a, const Candidate& b) { return key(a) > key(b); });
}

/// @return latest finish.
double LevelMapper::mapInOrder(DagPlacement* placement)
{
  double last = 0.0;
  for (const Candidate& candidate : candidates_)
  {
    const DagPlacement::Place place = placement->earliest(candidate.node);
    placement->commit(candidate.node, place);
    last = std::max(last, place.finish());
  }
  return last;
}

/// Min-Min (Ibarra, Kim 1977). A unit only fills up, so a node's earliest finish changes only when the unit it would
/// take has just been given another node: each round looks again at those alone.
/// @return latest finish.
double LevelMapper::mapMinMin(DagPlacement* placement)
{
  for (Candidate& candidate : candidates_)
  {
    candidate.best = placement->earliest(candidate.node);
  }
  double last = 0.0;
  while (!candidates_.empty())
  {
    const auto first =
        std::min_element(candidates_.begin(), candidates_.end(),
                         [](const Candidate& a, const Candidate& b) { return a.best.finish() < b.best.finish(); });
    const DagPlacement::Place place = first->best;
    placement->commit(first->node, place);
    last = std::max(last, place.finish());
    candidates_.erase(first);
    for (Candidate& candidate : candidates_)
    {
      if (candidate.best.unit == place.unit)
      {
        candidate.best = placement->earliest(candidate.node);
      }
    }
  }
  return last;
}

}  // namespace pi_runtime
