#include "units/unit_timeline.h"

#include <algorithm>
#include <limits>

namespace pi_runtime
{
namespace
{

// What is left of the gap in front of a slot and behind it.
bool leavesFront(const UnitTimeline::Slot& slot)
{
  return slot.gap.begin < slot.start;
}
bool leavesRest(const UnitTimeline::Slot& slot)
{
  return slot.finish < slot.gap.end;
}

}  // namespace

void UnitTimeline::clear()
{
  gaps_.assign(1, {0.0, std::numeric_limits<double>::infinity()});
}

UnitTimeline::Slot UnitTimeline::firstSlot(double ready, double duration) const
{
  if (gaps_.back().begin <= ready)
  {
    return lastSlot(ready, duration);
  }
  auto gap = std::upper_bound(gaps_.begin(), gaps_.end(), ready,
                              [](double time, const Gap& other) { return time < other.end; });
  double start = std::max(ready, gap->begin);
  while (start + duration > gap->end)
  {
    ++gap;
    start = gap->begin;
  }
  return {start, start + duration, *gap, static_cast<std::size_t>(gap - gaps_.begin())};
}

UnitTimeline::Slot UnitTimeline::lastSlot(double ready, double duration) const
{
  const double start = std::max(ready, gaps_.back().begin);
  return {start, start + duration, gaps_.back(), gaps_.size() - 1};
}

void UnitTimeline::occupy(const Slot& slot)
{
  const auto gap = gaps_.begin() + static_cast<std::ptrdiff_t>(slot.index);
  const Gap rest{slot.finish, slot.gap.end};
  if (!leavesFront(slot) && !leavesRest(slot))
  {
    gaps_.erase(gap);
  }
  else if (!leavesFront(slot))
  {
    *gap = rest;
  }
  else
  {
    gap->end = slot.start;
    if (leavesRest(slot))
    {
      gaps_.insert(gap + 1, rest);
    }
  }
}

void UnitTimeline::release(const Slot& slot)
{
  const auto gap = gaps_.begin() + static_cast<std::ptrdiff_t>(slot.index);
  if (!leavesFront(slot) && !leavesRest(slot))
  {
    gaps_.insert(gap, slot.gap);
    return;
  }
  *gap = slot.gap;
  if (leavesFront(slot) && leavesRest(slot))
  {
    gaps_.erase(gap + 1);
  }
}

}  // namespace pi_runtime
