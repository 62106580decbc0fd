#pragma once

#include <pi_detect/obstacle_tracker.h>
#include <pi_detect/stereo_obstacles.h>
#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

#include "obstacles/occupancy_grid.h"

namespace pi_detect
{

/// What the obstacles node works on.
enum class StereoSource
{
  RECTIFIED,  ///< left/image_rect and right/image_rect
  RAW,        ///< left/image_raw and right/image_raw, rectified here
  DISPARITY,  ///< disparity
};
const char* toString(StereoSource source);  ///< "rectified", "raw", "disparity"

/// The parameters of the obstacles node; config/obstacles.yaml shows each with its unit.
struct ObstaclesRosOptions : pi_node::NodeParameters<ObstaclesRosOptions>
{
  StereoSource source = StereoSource::RECTIFIED;
  bool zero_copy = true;                ///< read raw pictures in the publisher's memory, if the transport can
  std::string image_transport = "raw";  ///< of the pictures
  double pair_tolerance_s = 0.005;      ///< between the stamps of a pair's pictures [s]
  double max_rate_hz = 0.0;             ///< pairs that come faster are left out [Hz]; 0: none is
  bool always_on = false;               ///< also while nobody listens
  bool use_runtime = true;              ///< stages of pi_runtime::Runtime::shared(); false: plain calls

  std::string base_link_frame = "base_link";
  std::string odom_frame = "odom";
  double tf_wait_s = 0.1;        ///< longest a pair waits for tf to reach its stamp [s]
  bool tracks_rectified = true;  ///< boxes of `tracks` are those of the rectified picture; false: of the raw one
  double max_track_age_s = 0.3;  ///< between the stamps of tracks and pair, above which tracks are not used [s]

  StereoObstacleOptions stereo;
  ObstacleTrackerOptions tracker;
  OccupancyGridOptions grid;
  /// Labels of what does not stay: never occupied in the grid, as everything that moves.
  std::vector<std::string> grid_leaves_out = {"person", "bicycle", "cat", "dog"};

  double min_coverage = 0.1;       ///< part of the pixels with a disparity, below which nothing is published
  double marker_lifetime_s = 0.5;  ///< after which rviz removes markers when no more come [s]
  double input_timeout_s = 2.0;    ///< without a message on an input, after which there is a warning [s]
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  void setVehicle(const pi_node::VehicleDescription& vehicle)
  {
    stereo.footprint = vehicle.footprint;
    tracker.footprint = vehicle.footprint;
  }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_detect

extern template struct pi_node::NodeParameters<pi_detect::ObstaclesRosOptions>;
