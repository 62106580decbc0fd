#include "ros/chassis_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(ChassisRosOptions& options, Visitor&& visit)
{
  auto& driver = options.driver;
  visit("port", driver.port);
  visit("baud_rate", driver.baud_rate);
  visit("start_patience_s", driver.start_patience_s);
  visit("first_pause_s", driver.first_pause_s);
  visit("longest_pause_s", driver.longest_pause_s);
  visit("command_period_s", driver.host.command_period_s);
  visit("status_timeout_s", driver.host.status_timeout_s);
  visit("motion_timeout_s", driver.host.motion_timeout_s);
  visit("stop_deceleration", driver.host.stop_deceleration);
  auto& limits = driver.host.limits;
  visit("limits/speed", limits.speed);
  visit("limits/reverse_speed", limits.reverse_speed);
  visit("limits/curvature", limits.curvature);
  visit("limits/acceleration", limits.acceleration);
  visit("limits/deceleration", limits.deceleration);
  visit("limits/usual_deceleration", limits.usual_deceleration);
  visit("limits/lateral_acceleration", limits.lateral_acceleration);
  visit("odom_frame", options.odom_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("publish_tf", options.publish_tf);
  visit("odometry/distance_error", options.odometry.distance_error);
  visit("odometry/heading_error", options.odometry.heading_error);
  visit("odometry/speed_error", options.odometry.speed_error);
  visit("odometry/yaw_rate_error", options.odometry.yaw_rate_error);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void ChassisRosOptions::validate() const
{
  driver.validate();
  pi_node::parameters::require(!odom_frame.empty(), "odom_frame", "\"\"", "a name");
  pi_node::parameters::require(!base_link_frame.empty() && base_link_frame != odom_frame, "base_link_frame",
                               "\"" + base_link_frame + "\"", "a name other than odom_frame");
  const pi_node::OptionCheck check("odometry");
  check.range("distance_error", odometry.distance_error, 0.0, 10.0);
  check.range("heading_error", odometry.heading_error, 0.0, 10.0);
  check.range("speed_error", odometry.speed_error, 0.0, 10.0);
  check.range("yaw_rate_error", odometry.yaw_rate_error, 0.0, 10.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::ChassisRosOptions>;
