#pragma once

#include "decision/arbiter.h"
#include "ros/decision_ros_options.h"
#include "ros/kept_parameters.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/Twist.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/ArbiterState.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// Runs the Arbiter on the graph. Only this node publishes `motion` (pi_vehicle/MotionCommand, at a steady rate), from
/// `motion/<source>` of every source in sources_file and, if there is a source `remote`, from `remote/cmd_vel`
/// (geometry_msgs/Twist). `vehicle_state` gives the measured speed. Publishes `arbiter/state`
/// (pi_vehicle/ArbiterState, latched, when it changes) and diagnostics. Private services `emergency_stop` and
/// `release_emergency_stop` (std_srvs/Trigger); the latch is kept in the private parameter `latched` (its reason) and
/// outlives this node. Decisions: decision/arbiter.h.
///
/// A command for a lower speed than the present one is published on arrival, others at the next tick.
/// While the ROS clock stands still there are no ticks, and the watchdog of the chassis stops the vehicle.
/// One thread, `arbiter`, has all callbacks.
class ArbiterRos
{
public:
  /// Advertises, and begins to publish. @throws std::invalid_argument for wrong parameters or a wrong sources_file.
  ArbiterRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~ArbiterRos();
  ArbiterRos(const ArbiterRos&) = delete;
  ArbiterRos& operator=(const ArbiterRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  struct Intake
  {
    ros::Subscriber subscriber;
    uint64_t taken = 0;
    uint64_t refused = 0;
  };

  void onMotion(size_t source, const MotionCommand& message);
  void onTwist(size_t source, const geometry_msgs::Twist& message);
  void onVehicleState(const VehicleState& message);
  bool onEmergencyStop(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onRelease(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void submit(size_t source, const DriveCommand& command, const ros::Time& stamp);
  void tick();
  void publish(const ros::Time& now);
  void reportArbiter(Status& status) const;
  void reportSources(Status& status) const;

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  ros::NodeHandle private_node_;
  const ArbiterRosOptions options_;
  const std::string sources_path_;
  Arbiter arbiter_;
  pi_node::WarningBoard warnings_;
  KeptParameters kept_;
  diagnostic_updater::Updater updater_;

  ros::Publisher motion_;
  pi_node::LatchedPublisher<ArbiterState> state_publisher_;
  std::vector<Intake> intakes_;  ///< in the order of the sources
  ros::Subscriber cmd_vel_;
  ros::Subscriber vehicle_state_;
  ros::ServiceServer emergency_stop_;
  ros::ServiceServer release_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer diagnostic_timer_;

  ros::Time last_tick_;
  ArbiterOutput output_;
  ArbiterState state_;
  double measured_speed_ = 0.0;
  ros::Time measured_at_;  ///< zero: never
};

}  // namespace pi_vehicle
