#include "ros/base/base_commands.h"

#include "ros/base/chassis_conversions.h"

#include <pi_node/formatting.h>

#include <utility>

namespace pi_vehicle
{

using chassis::HostMode;
using pi_node::format;

std::string toText(const chassis::HostState& state)
{
  static constexpr const char* NAMES[] = {"ready",          "driving", "stopped by a watchdog",
                                          "emergency stop", "fault",   "disconnected"};
  return NAMES[static_cast<size_t>(state.mode)] + (state.detail.empty() ? std::string() : ": " + state.detail);
}

void ModeLog::log(const chassis::HostState& state)
{
  if (state.mode == std::exchange(mode_, state.mode))
  {
    return;
  }
  const std::string text = toText(state);
  if (state.mode == HostMode::READY || state.mode == HostMode::DRIVING)
  {
    ROS_INFO_STREAM_NAMED("chassis", text);
  }
  else if (state.mode == HostMode::FAULT)
  {
    ROS_ERROR_STREAM_NAMED("chassis", text);
  }
  else
  {
    ROS_WARN_STREAM_NAMED("chassis", text);
  }
}

BaseCommands::BaseCommands(ros::NodeHandle node, double motion_timeout_s, pi_node::WarningBoard* warnings,
                           Events events)
  : motion_timeout_s_(motion_timeout_s), warnings_(warnings), events_(std::move(events))
{
  // The newest command is the one that counts.
  motion_ = node.subscribe("motion", 1, &BaseCommands::onMotion, this, ros::TransportHints().tcpNoDelay());
  emergency_topic_ = node.subscribe("emergency_stop", 10, &BaseCommands::onEmergencyTopic, this);
  emergency_stop_ = node.advertiseService("emergency_stop", &BaseCommands::onEmergencyStop, this);
  release_ = node.advertiseService("release_emergency_stop", &BaseCommands::onRelease, this);
}

void BaseCommands::onMotion(const MotionCommand& message)
{
  const double age_s = message.header.stamp.isZero() ? 0.0 : (ros::Time::now() - message.header.stamp).toSec();
  if (age_s > motion_timeout_s_)
  {
    warnings_->warn("a motion command was " + format("%.2f", age_s) +
                    " s old and refused; are the clocks of this computer and of " +
                    (message.source.empty() ? "its source" : message.source) + " the same?");
    return;
  }
  if (!events_.motion(fromMsg(message)))
  {
    warnings_->warn("a motion command of " + (message.source.empty() ? "an unnamed source" : message.source) +
                    " was refused: speed, curvature and max_deceleration must be finite, the last not negative");
  }
}

void BaseCommands::onEmergencyTopic(const std_msgs::Bool& message)
{
  if (message.data != 0)
  {
    events_.emergency_stop("asked on topic emergency_stop");
  }
}

bool BaseCommands::onEmergencyStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  events_.emergency_stop("asked by service emergency_stop");
  response.success = true;
  response.message = "stops; call release_emergency_stop to drive again";
  return true;
}

bool BaseCommands::onRelease(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  events_.release();
  response.success = true;
  response.message = "released; drives at the next motion command";
  return true;
}

}  // namespace pi_vehicle
