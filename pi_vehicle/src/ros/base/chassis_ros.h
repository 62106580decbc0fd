#pragma once

#include "ros/base/base_commands.h"
#include "ros/base/chassis_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/chassis/chassis_driver.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <cstdint>
#include <memory>
#include <string>

namespace pi_vehicle
{

/// Runs the ChassisDriver on the graph. Subscribes `motion` (pi_vehicle/MotionCommand); publishes `vehicle_state`
/// (pi_vehicle/VehicleState, once per command_period_s, connected or not), `wheel_odometry` (nav_msgs/Odometry, one per
/// status of the chassis), `battery` (sensor_msgs/BatteryState, 1 Hz), diagnostics, and tf where asked. Services
/// `emergency_stop` and `release_emergency_stop` (std_srvs/Trigger): the first stops at once and latches, the second
/// ends the latch and clears faults that are gone.
///
/// Two threads: `chassis` has the serial line and publishes state and odometry; `chassis_ros` has callbacks and
/// diagnostics. A motion command that is not finite, or older than motion_timeout_s, is refused with a warning: the
/// vehicle stops when no good one comes.
class ChassisRos
{
public:
  /// Advertises, and begins to drive. @throws std::invalid_argument for wrong parameters.
  ChassisRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Stops the vehicle.
  ~ChassisRos();
  ChassisRos(const ChassisRos&) = delete;
  ChassisRos& operator=(const ChassisRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  // chassis
  void onState(const chassis::DriverState& state);

  // chassis_ros
  void publishDiagnostics();
  void reportChassis(Status& status) const;
  void reportLine(Status& status) const;
  void reportBattery(Status& status) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  const ChassisRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  ros::Publisher state_publisher_;
  ros::Publisher odometry_publisher_;
  ros::Publisher battery_publisher_;
  pi_node::VehicleTimer timer_;

  // chassis
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;  ///< none: no tf
  uint64_t odometry_count_ = 0;
  int64_t battery_ns_ = 0;
  ModeLog mode_log_;

  // chassis_ros
  chassis::DriverState report_;  ///< at this update
  uint64_t garbage_before_ = 0;  ///< bytes, at the update before
  uint64_t garbage_lately_ = 0;

  std::unique_ptr<chassis::ChassisDriver> driver_;
  std::unique_ptr<BaseCommands> commands_;
};

}  // namespace pi_vehicle
