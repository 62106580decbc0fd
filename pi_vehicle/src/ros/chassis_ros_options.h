#pragma once

#include <pi_vehicle/chassis/chassis_driver.h>
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

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
struct ChassisRosOptions
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

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static ChassisRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static ChassisRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                          std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_vehicle
