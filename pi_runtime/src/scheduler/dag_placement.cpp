#include "scheduler/dag_placement.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_runtime
{

void DagPlacement::begin(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                         const StartTimes& start_times, bool insertion, DagPlan* plan)
{
  graph_ = &graph;
  etc_ = &etc;
  transfers_ = &transfers;
  start_times_ = &start_times;
  insertion_ = insertion;
  barrier_ = 0.0;
  plan_ = plan;
  timelines_.resize(etc.units());
  for (UnitTimeline& timeline : timelines_)
  {
    timeline.clear();
  }
}

double DagPlacement::ready(uint32_t node, uint32_t unit) const
{
  double time = barrier_;
  if (!start_times_->available.empty())
  {
    time = std::max(time, start_times_->available[unit]);
  }
  if (!start_times_->release.empty())
  {
    time = std::max(time, start_times_->release[node]);
  }
  for (const TaskGraph::Link& predecessor : graph_->predecessors(node))
  {
    const uint32_t from = plan_->unit[predecessor.node];
    if (from != DagPlan::NO_UNIT)
    {
      time = std::max(time, plan_->finish[predecessor.node] + transfers_->time(from, unit, predecessor.bytes));
    }
  }
  return time;
}

DagPlacement::Place DagPlacement::earliest(uint32_t node, uint32_t unit) const
{
  const double duration = etc_->at(node, unit);
  if (duration == std::numeric_limits<double>::infinity())
  {
    return {unit, {0.0, duration, {}, 0}};
  }
  const UnitTimeline& timeline = timelines_[unit];
  const double start = ready(node, unit);
  return {unit, insertion_ ? timeline.firstSlot(start, duration) : timeline.lastSlot(start, duration)};
}

DagPlacement::Place DagPlacement::earliest(uint32_t node) const
{
  Place best = earliest(node, 0);
  for (uint32_t unit = 1; unit < units(); ++unit)
  {
    const Place place = earliest(node, unit);
    if (place.finish() < best.finish())
    {
      best = place;
    }
  }
  return best;
}

void DagPlacement::commit(uint32_t node, const Place& place)
{
  if (!std::isfinite(place.finish()))
  {
    throw std::invalid_argument("inner-core scheduler: node " + std::to_string(node) +
                                " would never finish: the times and transfers before it add up to infinity");
  }
  timelines_[place.unit].occupy(place.slot);
  plan_->unit[node] = place.unit;
  plan_->start[node] = place.slot.start;
  plan_->finish[node] = place.slot.finish;
}

void DagPlacement::undo(uint32_t node, const Place& place)
{
  timelines_[place.unit].release(place.slot);
  plan_->unit[node] = DagPlan::NO_UNIT;
}

}  // namespace pi_runtime
