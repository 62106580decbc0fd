#pragma once

#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

#include "ros/tracker_parameters.h"

namespace pi_detect
{

/// The parameters of the tracker node; config/tracker.yaml shows each with its unit.
struct TrackerRosOptions : pi_node::NodeParameters<TrackerRosOptions>
{
  TrackerParameters tracker;
  bool rectified = false;         ///< detections are of rectified pictures: P of camera_info counts
  bool always_on = false;         ///< also while nobody listens
  double warning_period_s = 5.0;  ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_detect

extern template struct pi_node::NodeParameters<pi_detect::TrackerRosOptions>;
