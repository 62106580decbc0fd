#include "ros/joystick_ros.h"

#include <geometry_msgs/Twist.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/ros/parameter_tree.h>
#include <pi_node/vehicle_clock.h>
#include <std_msgs/Bool.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(JoystickRosOptions& options, Visitor&& visit)
{
  visit("device", options.device);
  visit("rate", options.rate);
  visit("joy_timeout_s", options.joy_timeout_s);
  visit("dead_man_button", options.dead_man_button);
  visit("emergency_button", options.emergency_button);
  visit("speed_axis", options.speed_axis);
  visit("steering_axis", options.steering_axis);
  visit("max_speed", options.max_speed);
  visit("dead_zone", options.dead_zone);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void JoystickRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("rate", rate, 10.0, 200.0);
  check.range("joy_timeout_s", joy_timeout_s, 0.05, 10.0);
  check.range("dead_man_button", dead_man_button, 0, 255);
  check.range("emergency_button", emergency_button, 0, 255);
  check.range("speed_axis", speed_axis, 0, 255);
  check.range("steering_axis", steering_axis, 0, 255);
  check.range("max_speed", max_speed, 0.05, limits.speed, "vehicle/limits/speed");
  check.range("dead_zone", dead_zone, 0.0, 0.9);
  pi_node::parameters::require(emergency_button != dead_man_button, "emergency_button",
                               std::to_string(emergency_button), "another button than dead_man_button");
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

namespace
{

using diagnostic_msgs::DiagnosticStatus;

bool isPressed(const sensor_msgs::Joy& joy, int button)
{
  return static_cast<size_t>(button) < joy.buttons.size() && joy.buttons[static_cast<size_t>(button)] != 0;
}

}  // namespace

JoystickRos::JoystickRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("joystick")
  , node_(thread_.handle(node))
  , options_(pi_node::loadNodeOptions<JoystickRosOptions>(private_node, "joystick"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<JoystickRosOptions>("joystick"))
  , updater_(node_, private_node, private_node.getNamespace())
{
  twist_ = node_.advertise<geometry_msgs::Twist>("remote/cmd_vel", 1);
  emergency_stop_ = node_.advertise<std_msgs::Bool>("emergency_stop", 1);
  if (options_.device.empty())
  {
    joy_ = node_.subscribe("joy", 10, &JoystickRos::onJoy, this, ros::TransportHints().tcpNoDelay());
  }
  else
  {
    joy_publisher_ = node_.advertise<sensor_msgs::Joy>("joy", 10);
    device_ = std::make_unique<JoystickDevice>(options_.device);
  }
  updater_.setHardwareID(options_.device.empty() ? "joy" : options_.device);
  updater_.add("joystick", [this](Status& status) { report(status); });
  timer_ = pi_node::VehicleTimer(node_, 1.0 / options_.rate, [this] { tick(); });
  diagnostic_timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

JoystickRos::~JoystickRos()
{
  thread_.stop();
  release();
}

void JoystickRos::onJoy(const sensor_msgs::Joy& message)
{
  message_ = boost::make_shared<const sensor_msgs::Joy>(message);
  message_ns_ = pi_node::vehicleNs();
  tick();
}

std::optional<sensor_msgs::Joy> JoystickRos::readDevice()
{
  const bool was_there = problem_.empty();
  const auto state = device_->update(&problem_);
  if (!state)
  {
    if (was_there)
    {
      ROS_ERROR_STREAM_NAMED("joystick", problem_ << "; tried again until it is there");
    }
    return std::nullopt;
  }
  if (!was_there)
  {
    ROS_INFO_STREAM_NAMED("joystick", "joystick " << options_.device << " is there");
  }
  sensor_msgs::Joy joy;
  joy.header.stamp = ros::Time::now();
  joy.axes = state->axes;
  joy.buttons.assign(state->buttons.begin(), state->buttons.end());
  if (state->changed)
  {
    joy_publisher_.publish(joy);
  }
  return joy;
}

std::optional<sensor_msgs::Joy> JoystickRos::lastMessage()
{
  if (!message_ || pi_node::secondsBetween(message_ns_, pi_node::vehicleNs()) > options_.joy_timeout_s)
  {
    problem_ = "nothing comes on " + joy_.getTopic() + "; does a joystick node run, and does it repeat its messages?";
    return std::nullopt;
  }
  problem_.clear();
  return *message_;
}

void JoystickRos::tick()
{
  const std::optional<sensor_msgs::Joy> joy = device_ ? readDevice() : lastMessage();
  if (joy && isPressed(*joy, options_.emergency_button) != emergency_)
  {
    emergency_ = !emergency_;
    if (emergency_)
    {
      std_msgs::Bool stop;
      stop.data = 1;
      emergency_stop_.publish(stop);
      ROS_WARN_STREAM_NAMED("joystick", "emergency stop");
    }
  }
  if (joy && !emergency_ && isPressed(*joy, options_.dead_man_button))
  {
    drive(*joy);
  }
  else
  {
    release();
  }
}

void JoystickRos::drive(const sensor_msgs::Joy& joy)
{
  const auto axes = static_cast<int>(joy.axes.size());
  if (const int highest = std::max(options_.speed_axis, options_.steering_axis); highest >= axes)
  {
    warnings_.warn("the joystick has " + std::to_string(axes) + " axes, not axis " + std::to_string(highest) +
                   "; see speed_axis and steering_axis");
    release();
    return;
  }
  held_ = true;
  geometry_msgs::Twist twist;
  twist.linear.x = options_.max_speed * axis(joy, options_.speed_axis);
  twist.angular.z = twist.linear.x * options_.limits.curvature * axis(joy, options_.steering_axis);
  twist_.publish(twist);
}

void JoystickRos::release()
{
  if (std::exchange(held_, false))
  {
    twist_.publish(geometry_msgs::Twist());
  }
}

/// Without the dead zone; 0 for what is not finite.
double JoystickRos::axis(const sensor_msgs::Joy& joy, int index) const
{
  const double value = joy.axes[static_cast<size_t>(index)];
  const double beyond = std::abs(value) - options_.dead_zone;
  return beyond > 0.0 ? std::copysign(std::min(1.0, beyond / (1.0 - options_.dead_zone)), value) : 0.0;
}

void JoystickRos::report(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  if (!problem_.empty())
  {
    status.summary(DiagnosticStatus::ERROR, problem_);
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, held_ ? "drives" : "dead-man button released");
  }
  status.add("emergency button", emergency_ ? "pressed" : "released");
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::JoystickRosOptions>;
