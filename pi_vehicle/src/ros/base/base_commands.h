#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/chassis/chassis_host.h>
#include <ros/ros.h>
#include <std_msgs/Bool.h>
#include <std_srvs/Trigger.h>

#include <functional>
#include <string>

namespace pi_vehicle
{

/// "ready", "disconnected: ...".
std::string toText(const chassis::HostState& state);

/// Logs each change of the mode once.
class ModeLog
{
public:
  void log(const chassis::HostState& state);

private:
  chassis::HostMode mode_ = chassis::HostMode::READY;
};

/// What the driver of any base takes: `motion` (pi_vehicle/MotionCommand), the services `emergency_stop` and
/// `release_emergency_stop` (std_srvs/Trigger), and the topic `emergency_stop` (std_msgs/Bool): true stops as the
/// service does, false does nothing. Warns of motions that are old or not finite. Of the node's callback thread.
class BaseCommands
{
public:
  struct Events
  {
    std::function<bool(const chassis::Motion&)> motion;  ///< @return false if it is refused
    std::function<void(const std::string& reason)> emergency_stop;
    std::function<void()> release;
  };

  /// @param warnings  outlives this.
  BaseCommands(ros::NodeHandle node, double motion_timeout_s, pi_node::WarningBoard* warnings, Events events);

private:
  void onMotion(const MotionCommand& message);
  void onEmergencyTopic(const std_msgs::Bool& message);
  bool onEmergencyStop(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onRelease(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  const double motion_timeout_s_;
  pi_node::WarningBoard* const warnings_;
  const Events events_;
  ros::Subscriber motion_;
  ros::Subscriber emergency_topic_;
  ros::ServiceServer emergency_stop_;
  ros::ServiceServer release_;
};

}  // namespace pi_vehicle
