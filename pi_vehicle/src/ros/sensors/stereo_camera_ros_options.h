#pragma once

#include "sensors/video_source.h"

#include <pi_node/ros/node_parameters.h>

#include <string>

namespace pi_vehicle
{

/// The parameters of the camera node; config/stereo_camera.yaml shows each with its unit.
struct StereoCameraRosOptions : pi_node::NodeParameters<StereoCameraRosOptions>
{
  VideoOptions video = {"/dev/video0"};
  std::string right_device;              ///< empty: the pictures of `device` are left and right side by side
  bool color = true;                     ///< bgr8; false: mono8
  double max_time_difference_s = 0.002;  ///< of two devices' pictures [s]
  std::string left_frame = "left_optical";
  std::string right_frame = "right_optical";
  std::string left_calibration;  ///< absolute path or URL of camera_info_manager; empty: its default
  std::string right_calibration;
  double reconnect_pause_s = 1.0;  ///< [s]
  double diagnostic_period = 1.0;  ///< [s]
  double warning_period_s = 5.0;   ///< [s]

  bool isSideBySide() const { return right_device.empty(); }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::StereoCameraRosOptions>;
