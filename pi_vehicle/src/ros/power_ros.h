#pragma once

#include "power/service_meter.h"
#include "ros/node_finder.h"
#include "ros/power_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/power_monitor.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/PowerState.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>

#include <memory>
#include <optional>
#include <string>

namespace pi_vehicle
{

/// Measures processor time, memory and power of the services on this computer. Subscribes `vehicle_state`
/// (pi_vehicle/VehicleState); publishes `power` (pi_vehicle/PowerState) and `battery` (sensor_msgs/BatteryState) once
/// per period_s, and diagnostics.
///
/// The battery is the one of vehicle_state while that comes with a charge, else the one of the computer in /sys.
/// Two threads: `power` has callbacks and reads /proc and /sys; `power_nodes` asks master and nodes.
class PowerRos
{
public:
  /// Advertises, and begins to measure. @throws std::invalid_argument for wrong parameters.
  PowerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~PowerRos();
  PowerRos(const PowerRos&) = delete;
  PowerRos& operator=(const PowerRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void onVehicleState(const VehicleState& message);
  void measure();
  power::BatteryReading batteryNow(const pi_node::PowerReading& reading);
  void publishPower(const ros::Time& stamp);
  void publishBattery(const ros::Time& stamp);
  void reportServices(Status& status) const;
  void reportPower(Status& status) const;
  void reportBattery(Status& status) const;

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const PowerRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  ros::Publisher power_publisher_;
  ros::Publisher battery_publisher_;
  ros::Subscriber vehicle_state_;
  ros::WallTimer measure_timer_;
  ros::WallTimer diagnostic_timer_;

  // power
  power::ServiceMeter meter_;
  pi_node::PowerMonitor monitor_;
  power::BatteryEstimator estimator_;
  std::optional<VehicleState> vehicle_;
  int64_t vehicle_ns_ = 0;
  power::MachineUse use_;
  power::PowerAccount account_;
  power::BatteryReading battery_;
  std::string battery_source_;
  power::BatteryEstimate estimate_;
  NodeFinder::Found found_;

  std::unique_ptr<NodeFinder> finder_;
};

}  // namespace pi_vehicle
