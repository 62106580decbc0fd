#pragma once

namespace pi_detect
{

/// The parameters of the object tracker, of every node that has one.
template <typename Tracker, typename Visitor>
void visitTrackerFields(Tracker& tracker, Visitor&& visit)
{
  visit("tracker/high_score", tracker.high_score);
  visit("tracker/low_score", tracker.low_score);
  visit("tracker/min_overlap", tracker.min_overlap);
  visit("tracker/margin", tracker.margin);
  visit("tracker/time_to_live_s", tracker.time_to_live_s);
  visit("tracker/confirm_hits", tracker.confirm_hits);
  visit("tracker/max_gap_s", tracker.max_gap_s);
  visit("tracker/max_objects", tracker.max_objects);
}

}  // namespace pi_detect
