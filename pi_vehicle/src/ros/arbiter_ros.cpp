#include "ros/arbiter_ros.h"

#include "ros/decision_conversions.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>

#include <cmath>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t MOTION_QUEUE = 50;
constexpr char KEPT_LATCH[] = "latched";  // the parameter that outlives the node
constexpr char REMOTE[] = "remote";       // the source that remote/cmd_vel is

}  // namespace

ArbiterRos::ArbiterRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("arbiter")
  , node_(thread_.handle(node))
  , private_node_(thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<ArbiterRosOptions>(private_node, "arbiter", {KEPT_LATCH}, "arbiter_node"))
  , sources_path_(configPath("sources_file", options_.sources_file))
  , arbiter_(ArbiterOptions::load(sources_path_, options_.limits))
  , warnings_(options_.warning_period_s, pi_node::warningLog<ArbiterRosOptions>("arbiter"))
  , kept_(private_node)
  , updater_(node_, private_node, private_node.getNamespace())
  , intakes_(arbiter_.sources().size())
{
  std::string latched;
  kept_.find(KEPT_LATCH, "a text", &latched);
  if (!latched.empty())
  {
    arbiter_.emergencyStop(latched);
    ROS_WARN_STREAM_NAMED("arbiter", "the emergency stop of an earlier life holds: " << latched);
  }
  motion_ = node_.advertise<MotionCommand>("motion", MOTION_QUEUE);
  state_publisher_ = pi_node::LatchedPublisher<ArbiterState>(node_, "arbiter/state", MOTION_QUEUE);
  updater_.setHardwareID("none");
  updater_.add("arbiter", [this](Status& status) { reportArbiter(status); });
  updater_.add("sources", [this](Status& status) { reportSources(status); });

  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  for (size_t i = 0; i < intakes_.size(); ++i)
  {
    const std::string& name = arbiter_.options().sources[i].name;
    // The newest command of a source is the one that counts.
    intakes_[i].subscriber = node_.subscribe<MotionCommand>(
        "motion/" + name, 1, [this, i](const MotionCommand::ConstPtr& message) { onMotion(i, *message); },
        ros::VoidConstPtr(), hints);
    if (name == REMOTE)
    {
      cmd_vel_ = node_.subscribe<geometry_msgs::Twist>(
          "remote/cmd_vel", 1, [this, i](const geometry_msgs::Twist::ConstPtr& message) { onTwist(i, *message); },
          ros::VoidConstPtr(), hints);
    }
  }
  vehicle_state_ = node_.subscribe("vehicle_state", 1, &ArbiterRos::onVehicleState, this, hints);
  emergency_stop_ = private_node_.advertiseService("emergency_stop", &ArbiterRos::onEmergencyStop, this);
  release_ = private_node_.advertiseService("release_emergency_stop", &ArbiterRos::onRelease, this);
  timer_ = pi_node::VehicleTimer(
      node_, 1.0 / options_.rate, [this] { tick(); }, "arbiter");
  diagnostic_timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

ArbiterRos::~ArbiterRos()
{
  thread_.stop();
}

void ArbiterRos::onMotion(size_t source, const MotionCommand& message)
{
  const std::string& name = arbiter_.options().sources[source].name;
  if (!message.source.empty() && message.source != name)
  {
    warnings_.warn("a command on motion/" + name + " names " + message.source + " as its source; taken as one of " +
                   name + ", as the topic says");
  }
  submit(source, toDriveCommand(message, name), message.header.stamp);
}

void ArbiterRos::onTwist(size_t source, const geometry_msgs::Twist& message)
{
  submit(source, toDriveCommand(message, arbiter_.options().sources[source].name), ros::Time());
}

void ArbiterRos::submit(size_t source, const DriveCommand& command, const ros::Time& stamp)
{
  const ros::Time now = ros::Time::now();
  if (now.isZero())
  {
    return;  // simulated time has not begun here, but has at the source
  }
  const ros::Time spoken = stamp.isZero() ? now : stamp;
  const ArbiterAnswer answer = arbiter_.submit(command, toNs(spoken), toNs(now));
  if (answer != ArbiterAnswer::TAKEN)
  {
    ++intakes_[source].refused;
    warnings_.warn("a command of " + command.source + " was refused: " + toString(answer) + " (speed " +
                   format("%g", command.speed) + " m/s, " + format("%.3f", (now - spoken).toSec()) + " s old)");
    return;
  }
  ++intakes_[source].taken;
  if (std::abs(command.speed) < std::abs(output_.command.speed))
  {
    publish(now);
  }
}

void ArbiterRos::onVehicleState(const VehicleState& message)
{
  // Without a chassis its figures are the last known.
  if (message.mode != VehicleState::DISCONNECTED && std::isfinite(message.speed))
  {
    measured_speed_ = message.speed;
    measured_at_ = message.header.stamp;
  }
}

bool ArbiterRos::onEmergencyStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  const std::string reason = "asked by service emergency_stop";
  arbiter_.emergencyStop(reason);
  publish(ros::Time::now());
  kept_.keep(KEPT_LATCH, reason);
  ROS_WARN_STREAM_NAMED("arbiter", "emergency stop: " << reason);
  response.success = true;
  response.message = "stops; call release_emergency_stop to drive again";
  return true;
}

bool ArbiterRos::onRelease(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  response.success = arbiter_.releaseEmergencyStop();
  if (response.success == 0)
  {
    response.message = "the vehicle still moves; the stop can be released once it stands";
    return true;
  }
  kept_.keep(KEPT_LATCH, std::string());
  response.message = "released; drives when a source asks";
  ROS_INFO_STREAM_NAMED("arbiter", "emergency stop released");
  return true;
}

void ArbiterRos::tick()
{
  const ros::Time now = ros::Time::now();
  if (!now.isZero() && now != last_tick_)
  {
    last_tick_ = now;
    publish(now);
  }
}

void ArbiterRos::publish(const ros::Time& now)
{
  const double age_s = (now - measured_at_).toSec();
  const bool measured = !measured_at_.isZero() && std::abs(age_s) <= options_.vehicle_state_timeout;
  output_ = arbiter_.update(toNs(now), measured ? std::make_optional(measured_speed_) : std::nullopt);
  motion_.publish(toMotionCommand(output_.command, now));

  const ArbiterState state = toArbiterState(arbiter_, output_, now);
  if (state_.header.stamp.isZero() || !sameState(state, state_))
  {
    state_ = state;
    state_publisher_.publish(state_);
  }
}

void ArbiterRos::reportArbiter(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const DriveCommand& command = output_.command;
  if (output_.emergency_stop)
  {
    status.summary(DiagnosticStatus::WARN, command.reason + "; call release_emergency_stop to drive again");
  }
  else if (output_.missing)
  {
    status.summary(DiagnosticStatus::ERROR, command.reason);
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    const std::string who = output_.driver.empty() ? command.reason : output_.driver + " drives";
    const std::string limit = output_.limited_by.empty() ? "" : ", " + output_.limited_by + " limits";
    status.summary(DiagnosticStatus::OK, who + limit);
  }
  status.add("reason", command.reason);
  status.add("speed asked of the chassis [m/s]", format("%.2f", command.speed));
  status.add("curvature [1/m]", format("%.3f", command.curvature));
  status.add("measured speed [m/s]", measured_at_.isZero() ? "unknown" : format("%.2f", measured_speed_));
  status.add("sources_file", sources_path_);
  pi_node::addWarnings(warnings, &status);
}

void ArbiterRos::reportSources(Status& status) const
{
  status.summary(DiagnosticStatus::OK, "all required sources live");
  const ArbiterState state = toArbiterState(arbiter_, output_, ros::Time::now());
  for (size_t i = 0; i < state.sources.size(); ++i)
  {
    const SourceState& source = state.sources[i];
    const bool released = arbiter_.sources()[i].released;
    if (source.required && !source.alive && !released)
    {
      status.mergeSummary(DiagnosticStatus::ERROR, source.name + " is silent; does its node run?");
    }
    const std::string life = source.alive       ? "lives, last heard " + format("%.2f", source.age) + " s ago"
                             : released         ? "has ended"
                             : source.age < 0.0 ? "not heard yet"
                                                : "silent for " + format("%.1f", source.age) + " s";
    status.add(source.name, life + "; taken " + std::to_string(intakes_[i].taken) + ", refused " +
                                std::to_string(intakes_[i].refused));
  }
}

}  // namespace pi_vehicle
