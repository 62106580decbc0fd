#pragma once

#include <pi_node/ros/node_parameters.h>
#include <pi_vehicle/chassis/chassis_driver.h>

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

/// The parameters of the chassis node; config/chassis.yaml shows each with its unit.
struct ChassisRosOptions : pi_node::NodeParameters<ChassisRosOptions>
{
  chassis::DriverOptions driver;
  std::string odom_frame = "odom";
  std::string base_link_frame = "base_link";
  bool publish_tf = false;
  OdometryErrors odometry;
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::ChassisRosOptions>;
