#pragma once

#include <pi_detect/object_tracker.h>

#include <algorithm>
#include <string>

namespace pi_detect
{

/// The parameters of the object tracker, of every node that has one.
struct TrackerParameters : ObjectTrackerOptions
{
  TrackerParameters() { scores = {0.0, 0.0}; }

  std::string odom_frame = "odom";  ///< whose tf tells how the camera turned; empty: tf is not used

  /// With the network's scores where a parameter is 0.
  ObjectTrackerOptions forNetwork(const TrackerScores& network) const
  {
    ObjectTrackerOptions options = *this;
    options.scores.high = scores.high > 0.0 ? scores.high : std::max(network.high, scores.low);
    options.scores.low = scores.low > 0.0 ? scores.low : std::min(network.low, options.scores.high);
    return options;
  }

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const
  {
    if (scores.high != 0.0 && scores.low != 0.0)
    {
      ObjectTrackerOptions::validate();
      return;
    }
    ObjectTrackerOptions options = *this;
    options.scores = {std::max(scores.high, scores.low), scores.low};
    options.validate();
  }
};

template <typename Visitor>
void visitTrackerFields(TrackerParameters& tracker, Visitor&& visit)
{
  visit("tracker/high_score", tracker.scores.high);
  visit("tracker/low_score", tracker.scores.low);
  visit("tracker/min_overlap", tracker.min_overlap);
  visit("tracker/margin", tracker.margin);
  visit("tracker/time_to_live_s", tracker.time_to_live_s);
  visit("tracker/confirm_hits", tracker.confirm_hits);
  visit("tracker/max_gap_s", tracker.max_gap_s);
  visit("tracker/max_objects", tracker.max_objects);
  visit("tracker/odom_frame", tracker.odom_frame);
}

}  // namespace pi_detect
