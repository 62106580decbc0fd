#pragma once

#include <pi_node/ros/node_parameters.h>
#include "map/mapper.h"
#include "odometry/vio.h"
#include "ros/calibration_loader.h"

#include <string>
#include <vector>

namespace pi_slam
{

/// The parameters of the vio node; config/vio.yaml shows each with its unit. Those of `vio` and `mapper` have the names
/// of optionFields().
struct VioRosOptions : pi_node::NodeParameters<VioRosOptions>
{
  VioOptions vio;
  MapperOptions mapper;
  CalibrationOptions calibration;

  std::string map_frame = "map";
  std::string odom_frame = "odom";
  std::string base_link_frame = "base_link";
  std::string earth_frame = "earth";  ///< of tf earth -> map, with GNSS
  bool publish_tf = true;             ///< odom -> base_link
  bool publish_map_tf = true;         ///< map -> odom
  double tf_rate_hz = 50.0;  ///< of both; 0: with every IMU sample. Consumers interpolate, 200 Hz would be wasted

  bool use_runtime = true;  ///< heavy stages are jobs of pi_runtime::Runtime::shared(); false: plain calls

  bool mapping = true;    ///< false: odometry alone, map and odom are the same
  std::string map_file;   ///< map to begin with, as save_map wrote it; empty: none
  bool save_map = false;  ///< write the map to map_file when the node ends; the one before becomes map_file.before

  std::string wheel_topic;  ///< nav_msgs/Odometry or geometry_msgs/TwistStamped of the base; empty: no wheels
  std::string gnss_topic;   ///< sensor_msgs/NavSatFix; empty: no GNSS
  std::vector<double> gnss_antenna = {0.0, 0.0, 0.0};  ///< in base_link: x y z [m]
  bool zero_copy = true;            ///< pictures are read where their publisher wrote them, if the transport can
  int queue_size = 4;               ///< pairs that wait for the worker; the oldest go when it falls behind
  int imu_queue_size = 1000;        ///< samples that wait for their thread
  double pair_tolerance_s = 0.002;  ///< between the stamps of a pair's pictures [s]
  double pair_wait_s = 0.1;         ///< after which a picture goes on without its partner [s]
  double imu_wait_s = 0.5;          ///< longest a pair waits for the IMU to reach its stamp [s]
  double time_jump_s = 0.5;         ///< stamps that go back by more begin a new time [s]
  double input_timeout_s = 2.0;     ///< without a message on an input, after which there is a warning [s]
  double max_delay_s = 0.3;         ///< of pictures behind the IMU, above which there is a warning [s]

  double path_spacing_m = 0.05;    ///< between poses of `path` [m]
  int path_length = 5000;          ///< poses of `path` at most
  double path_period_s = 0.5;      ///< between messages, while somebody listens [s]
  double points_period_s = 1.0;    ///< likewise of `points` [s]
  double map_period_s = 2.0;       ///< likewise of `map` [s]
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_slam

extern template struct pi_node::NodeParameters<pi_slam::VioRosOptions>;
