#pragma once

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <string>

namespace pi_vehicle
{

/// How far wheel odometry may be wrong, one sigma each.
struct OdometryErrors
{
  double distance_error = 0.02;  ///< of the way driven
  double heading_error = 0.02;   ///< [rad/m] of the way driven
  double speed_error = 0.02;     ///< [m/s]
  double yaw_rate_error = 0.02;  ///< [rad/s]
};

/// Parameters of the odometry that every driver of a base publishes.
struct WheelOdometryOptions
{
  std::string odom_frame = "odom";
  std::string base_link_frame = "base_link";
  bool publish_tf = false;
  OdometryErrors errors;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const
  {
    pi_node::parameters::require(!odom_frame.empty(), "odom_frame", "\"\"", "a name");
    pi_node::parameters::require(!base_link_frame.empty() && base_link_frame != odom_frame, "base_link_frame",
                                 "\"" + base_link_frame + "\"", "a name other than odom_frame");
    const pi_node::OptionCheck check("odometry");
    check.range("distance_error", errors.distance_error, 0.0, 10.0);
    check.range("heading_error", errors.heading_error, 0.0, 10.0);
    check.range("speed_error", errors.speed_error, 0.0, 10.0);
    check.range("yaw_rate_error", errors.yaw_rate_error, 0.0, 10.0);
  }
};

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
void visitFields(WheelOdometryOptions& options, Visitor&& visit)
{
  visit("odom_frame", options.odom_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("publish_tf", options.publish_tf);
  visit("odometry/distance_error", options.errors.distance_error);
  visit("odometry/heading_error", options.errors.heading_error);
  visit("odometry/speed_error", options.errors.speed_error);
  visit("odometry/yaw_rate_error", options.errors.yaw_rate_error);
}

}  // namespace pi_vehicle
