#pragma once

#include "chassis/twist_base.h"
#include "ros/base/base_commands.h"
#include "ros/base/twist_base_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <memory>

namespace pi_vehicle
{

/// Drives a base whose own driver takes `cmd_vel` (geometry_msgs/Twist) and tells `odom` (nav_msgs/Odometry), in place
/// of ChassisRos: takes and publishes the same, but for the battery. `cmd_vel` goes out once per command_period_s,
/// ramped and within the limits; it is 0 while no odometry comes. One thread.
class TwistBaseRos
{
public:
  /// Advertises, and begins to drive. @throws std::invalid_argument for wrong parameters.
  TwistBaseRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Sends a last twist of 0.
  ~TwistBaseRos();
  TwistBaseRos(const TwistBaseRos&) = delete;
  TwistBaseRos& operator=(const TwistBaseRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void onOdometry(const nav_msgs::Odometry& message);
  void command();
  void reportChassis(Status& status) const;
  void reportLine(Status& status) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  const TwistBaseRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  chassis::TwistBase base_;
  ModeLog mode_log_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;  ///< none: no tf
  ros::Publisher twist_publisher_;
  ros::Publisher state_publisher_;
  ros::Publisher odometry_publisher_;
  ros::Subscriber odometry_;
  std::unique_ptr<BaseCommands> commands_;
  pi_node::VehicleTimer command_timer_;
  pi_node::VehicleTimer diagnostics_timer_;
};

}  // namespace pi_vehicle
