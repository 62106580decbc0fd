#include "ros/sensors/stereo_camera_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(StereoCameraRosOptions& options, Visitor&& visit)
{
  visit("device", options.video.device);
  visit("right_device", options.right_device);
  visit("pixel_format", options.video.pixel_format);
  visit("width", options.video.width);
  visit("height", options.video.height);
  visit("frame_rate", options.video.frame_rate);
  visit("color", options.color);
  visit("max_time_difference_s", options.max_time_difference_s);
  visit("left_frame", options.left_frame);
  visit("right_frame", options.right_frame);
  visit("left_calibration", options.left_calibration);
  visit("right_calibration", options.right_calibration);
  visit("reconnect_pause_s", options.reconnect_pause_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void StereoCameraRosOptions::validate() const
{
  using pi_node::parameters::require;
  const pi_node::OptionCheck check("");
  require(!video.device.empty(), "device", "\"\"", "a device of V4L2, as /dev/video0, or a recorded video");
  require(video.device != right_device, "right_device", "\"" + right_device + "\"",
          "another device, or empty for one device with both pictures side by side");
  require(video.pixel_format == "MJPG" || video.pixel_format == "YUYV", "pixel_format",
          "\"" + video.pixel_format + "\"", "MJPG or YUYV");
  check.range("width", video.width, 16, 16384);
  check.range("height", video.height, 16, 16384);
  require(!isSideBySide() || video.width % 2 == 0, "width", video.width, "even: left and right are side by side");
  check.range("frame_rate", video.frame_rate, 1.0, 240.0);
  // Beyond it a picture may have two partners.
  check.range("max_time_difference_s", max_time_difference_s, 1e-6, 0.5 / video.frame_rate);
  check.range("reconnect_pause_s", reconnect_pause_s, 0.05, 60.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::StereoCameraRosOptions>;
