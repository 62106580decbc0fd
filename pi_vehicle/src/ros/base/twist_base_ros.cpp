#include "ros/base/twist_base_ros.h"

#include "ros/base/chassis_conversions.h"

#include <geometry_msgs/Twist.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/vehicle_clock.h>
#include <tf2/utils.h>

#include <string>
#include <vector>

namespace pi_vehicle
{
namespace
{

using chassis::HostMode;
using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t QUEUE = 50;

geometry_msgs::Twist toTwist(const chassis::Twist& twist)
{
  geometry_msgs::Twist message;
  message.linear.x = twist.linear;
  message.angular.z = twist.angular;
  return message;
}

}  // namespace

TwistBaseRos::TwistBaseRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("twist_base_ros")
  , service_node_(service_thread_.handle(node))
  , options_(pi_node::loadNodeOptions<TwistBaseRosOptions>(private_node, "twist_base"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<TwistBaseRosOptions>("twist_base"))
  , updater_(service_node_, private_node, private_node.getNamespace())
  , base_(options_.base)
{
  twist_publisher_ = service_node_.advertise<geometry_msgs::Twist>("cmd_vel", 1);
  state_publisher_ = service_node_.advertise<VehicleState>("vehicle_state", QUEUE);
  odometry_publisher_ = service_node_.advertise<nav_msgs::Odometry>("wheel_odometry", QUEUE);
  if (options_.wheels.publish_tf)
  {
    broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
  }
  updater_.setHardwareID("cmd_vel");
  updater_.add("chassis", [this](Status& status) { reportChassis(status); });
  updater_.add("line", [this](Status& status) { reportLine(status); });
  odometry_ =
      service_node_.subscribe("odom", QUEUE, &TwistBaseRos::onOdometry, this, ros::TransportHints().tcpNoDelay());
  BaseCommands::Events events;
  events.motion = [this](const chassis::Motion& motion) { return base_.setMotion(motion, pi_node::vehicleNs()); };
  events.emergency_stop = [this](const std::string& reason) { base_.emergencyStop(reason); };
  events.release = [this] { base_.release(); };
  commands_ = std::make_unique<BaseCommands>(service_node_, options_.base.motion_timeout_s, &warnings_, events);
  command_timer_ = pi_node::VehicleTimer(service_node_, options_.base.command_period_s, [this] { command(); });
  diagnostics_timer_ =
      pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  service_thread_.start();
}

TwistBaseRos::~TwistBaseRos()
{
  service_thread_.stop();
  twist_publisher_.publish(geometry_msgs::Twist());
}

void TwistBaseRos::onOdometry(const nav_msgs::Odometry& message)
{
  const geometry_msgs::Pose& pose = message.pose.pose;
  const tf2::Quaternion q(pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w);
  const Pose2 place{pose.position.x, pose.position.y, tf2::getYaw(q)};
  if (!base_.onOdometry(place, message.twist.twist.linear.x, message.twist.twist.angular.z, pi_node::vehicleNs()))
  {
    warnings_.warn("odometry on " + odometry_.getTopic() + " was refused: a number is not finite");
    return;
  }
  const chassis::HostState state = base_.state(pi_node::vehicleNs());
  const ros::Time stamp = message.header.stamp.isZero() ? ros::Time::now() : message.header.stamp;
  const nav_msgs::Odometry odometry = toOdometry(state.odometry, stamp, options_.wheels);
  odometry_publisher_.publish(odometry);
  if (broadcaster_)
  {
    broadcaster_->sendTransform(toTransform(odometry));
  }
}

void TwistBaseRos::command()
{
  twist_publisher_.publish(toTwist(base_.poll(pi_node::vehicleNs())));
  const chassis::HostState state = base_.state(pi_node::vehicleNs());
  mode_log_.log(state);
  state_publisher_.publish(toVehicleState(state, ros::Time::now(), options_.wheels.base_link_frame));
}

void TwistBaseRos::reportChassis(Status& status) const
{
  const chassis::HostState state = base_.state(pi_node::vehicleNs());
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const bool well = (state.mode == HostMode::READY || state.mode == HostMode::DRIVING) && state.detail.empty();
  status.summary(state.mode == HostMode::DISCONNECTED ? DiagnosticStatus::ERROR
                 : well                               ? DiagnosticStatus::OK
                                                      : DiagnosticStatus::WARN,
                 toText(state));
  if (well && !warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  status.add("speed [m/s]", format("%.2f", state.status.speed));
  status.add("odometer [m]", format("%.1f", state.odometry.distance));
  status.add("motions cut to the limits", state.counters.limited_motions);
  status.add("motions refused", state.counters.refused_motions);
  pi_node::addWarnings(warnings, &status);
}

void TwistBaseRos::reportLine(Status& status) const
{
  const chassis::HostState state = base_.state(pi_node::vehicleNs());
  if (twist_publisher_.getNumSubscribers() == 0)
  {
    status.summary(DiagnosticStatus::ERROR, "nobody listens to " + twist_publisher_.getTopic() +
                                                "; is the base's driver running, and does it take this topic?");
  }
  else if (state.mode == HostMode::DISCONNECTED)
  {
    status.summary(DiagnosticStatus::ERROR, state.detail);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, twist_publisher_.getTopic() + ", " + odometry_.getTopic());
  }
  status.add("twists", state.counters.commands);
  status.add("odometries", state.counters.statuses);
  status.add("odometries refused", state.counters.refused_frames);
  status.add("jumps of the odometry", state.counters.restarts);
}

}  // namespace pi_vehicle
