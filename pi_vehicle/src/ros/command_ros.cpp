#include "ros/command_ros.h"

#include "ros/decision_conversions.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_vehicle/MotionCommand.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>

#include <cmath>
#include <vector>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t COMMAND_QUEUE = 50;
constexpr char COMMAND_SOURCE[] = "command";
constexpr double STANDING_KNOWN_S = 1.0;  ///< older reports of the chassis say nothing
// The parameters that outlive the node.
constexpr char LATCHED[] = "latched";
constexpr char KEPT_SPEED_LIMIT[] = "kept_speed_limit";

std_msgs::String toText(const std::string& text)
{
  std_msgs::String message;
  message.data = text;
  return message;
}

}  // namespace

CommandRos::CommandRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("command")
  , node_(thread_.handle(node))
  , private_node_(thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<CommandRosOptions>(private_node, "command", {LATCHED, KEPT_SPEED_LIMIT},
                                                         "command_node"))
  , actions_path_(configPath("actions_file", options_.actions_file))
  , actions_(CommandActionsOptions::load(actions_path_))
  , warnings_(options_.warning_period_s, pi_node::warningLog<CommandRosOptions>("command"))
  , kept_(private_node)
  , updater_(node_, private_node, private_node.getNamespace())
{
  motion_ = node_.advertise<MotionCommand>("motion/command", COMMAND_QUEUE);
  state_publisher_ = pi_node::LatchedPublisher<CommandState>(node_, "command/state", COMMAND_QUEUE);
  goal_ = node_.advertise<geometry_msgs::PoseStamped>("goal", COMMAND_QUEUE);
  turn_ = node_.advertise<std_msgs::String>("turn", COMMAND_QUEUE);
  say_ = node_.advertise<std_msgs::String>("say", COMMAND_QUEUE);
  horn_ = node_.advertise<std_msgs::Empty>("horn", COMMAND_QUEUE);
  updater_.setHardwareID("none");
  updater_.add("command", [this](Status& status) { report(status); });
  restore();

  command_ =
      node_.subscribe("command", COMMAND_QUEUE, &CommandRos::onCommand, this, ros::TransportHints().tcpNoDelay());
  doubtful_ = node_.subscribe("doubtful_command", COMMAND_QUEUE, &CommandRos::onDoubtful, this,
                              ros::TransportHints().tcpNoDelay());
  vehicle_state_ = node_.subscribe<VehicleState>(
      "vehicle_state", 1,
      [this](const VehicleState::ConstPtr& state) { standing_at_ = state->moving ? ros::Time() : state->header.stamp; },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  stop_ = private_node_.advertiseService("stop", &CommandRos::onStop, this);
  release_ = private_node_.advertiseService("release", &CommandRos::onRelease, this);
  timer_ = pi_node::VehicleTimer(
      node_, 1.0 / options_.rate, [this] { tick(); }, "command");
  diagnostic_timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

CommandRos::~CommandRos()
{
  thread_.stop();
}

void CommandRos::restore()
{
  bool latched = false;
  double speed_limit = actions_.keptSpeedLimit();
  kept_.find(LATCHED, "true or false", &latched);
  kept_.find(KEPT_SPEED_LIMIT, "a number", &speed_limit);
  const ros::Time now = ros::Time::now();
  actions_.restore(latched || options_.stopped_at_start, speed_limit, toNs(now));
  if (latched)
  {
    stop_reason_ = "stopped by an earlier life of this node, until released";
    ROS_WARN_STREAM_NAMED("command", stop_reason_);
  }
  else if (options_.stopped_at_start)
  {
    stop_reason_ = "stopped at the start, until released";
    kept_.keep(LATCHED, true);
  }
  publishState(now, "", "done", actions_.stopped() ? stop_reason_ : "started");
}

void CommandRos::onCommand(const pi_speech::VoiceCommand& message)
{
  const ros::Time now = ros::Time::now();
  handle(message.text, actions_.hear(message.text, spokenNs(message, now), toNs(now)), now);
}

void CommandRos::onDoubtful(const pi_speech::VoiceCommand& message)
{
  const ros::Time now = ros::Time::now();
  handle(message.text, actions_.hearDoubtful(message.text, moving(now), spokenNs(message, now), toNs(now)), now);
}

/// Unless the chassis says that it stands.
bool CommandRos::moving(const ros::Time& now) const
{
  return standing_at_.isZero() || std::abs((now - standing_at_).toSec()) > STANDING_KNOWN_S;
}

void CommandRos::handle(const std::string& text, const CommandResult& result, const ros::Time& now)
{
  if (result.outcome == CommandOutcome::DONE)
  {
    ++done_;
    if (actions_.stopped() && result.action != CommandAction::CANCEL)
    {
      stop_reason_ = result.reason;
    }
    publishMotion(now);  // first of all
    act(result, now);
    ROS_INFO_STREAM_NAMED("command", toString(result.action) << ": " << result.reason);
  }
  else if (result.outcome == CommandOutcome::AWAITS_CONFIRMATION)
  {
    publishMotion(now);
    ROS_INFO_STREAM_NAMED("command", result.reason);
    say(result.action == CommandAction::STOP ? options_.doubt_question : options_.question);
  }
  else
  {
    ++ignored_;
    warnings_.warn("ignored: " + result.reason);
  }
  doubted_ = actions_.doubted(toNs(now));
  publishState(now, text, toString(result.outcome), result.reason);
}

void CommandRos::act(const CommandResult& result, const ros::Time& now)
{
  switch (result.action)
  {
    case CommandAction::STOP:
    case CommandAction::GO:
    case CommandAction::CONFIRM:
      kept_.keep(LATCHED, actions_.stopped());
      break;
    case CommandAction::SLOWER:
    case CommandAction::FASTER:
      kept_.keep(KEPT_SPEED_LIMIT, actions_.keptSpeedLimit());
      break;
    case CommandAction::LEFT:
    case CommandAction::RIGHT:
      turn_.publish(toText(toString(result.action)));
      break;
    case CommandAction::GO_TO:
      goal_.publish(toGoal(result.place, now, options_.map_frame));
      break;
    case CommandAction::SAY:
      say(result.argument);
      break;
    case CommandAction::HORN:
      horn_.publish(std_msgs::Empty());
      break;
    case CommandAction::CANCEL:
      break;
  }
}

bool CommandRos::onStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  const ros::Time now = ros::Time::now();
  actions_.stop(toNs(now));
  stop_reason_ = "stopped by service stop, until released";
  publishMotion(now);
  kept_.keep(LATCHED, true);
  ROS_INFO_STREAM_NAMED("command", stop_reason_);
  publishState(now, "", toString(CommandOutcome::DONE), stop_reason_);
  response.success = true;
  response.message = "stopped; say \"go\" or call release to drive again";
  return true;
}

bool CommandRos::onRelease(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  const ros::Time now = ros::Time::now();
  response.success = true;
  response.message = actions_.stopped() ? "released" : "was not stopped";
  actions_.release();
  publishMotion(now);
  kept_.keep(LATCHED, false);
  ROS_INFO_STREAM_NAMED("command", response.message << " by service release");
  publishState(now, "", toString(CommandOutcome::DONE), response.message + " by service release");
  return true;
}

void CommandRos::say(const std::string& text)
{
  if (!text.empty())
  {
    say_.publish(toText(text));
  }
}

void CommandRos::tick()
{
  const ros::Time now = ros::Time::now();
  if (now.isZero())
  {
    return;
  }
  publishMotion(now);
  if (doubted_ && !actions_.doubted(toNs(now)))
  {
    doubted_ = false;
    ROS_INFO_STREAM_NAMED("command", "nobody confirmed the stop: drives on");
    publishState(now, "", toString(CommandOutcome::DONE), "nobody confirmed the stop: drives on");
  }
}

void CommandRos::publishMotion(const ros::Time& now)
{
  DriveCommand command;
  command.source = COMMAND_SOURCE;
  command.speed = actions_.speedLimit(toNs(now));
  if (actions_.stopped())
  {
    command.max_deceleration = options_.stop_deceleration;
    command.reason = stop_reason_;
  }
  else
  {
    command.reason = actions_.doubted(toNs(now)) ? "perhaps a stop" : "limit by command";
  }
  motion_.publish(toMotionCommand(command, now));
}

void CommandRos::publishState(const ros::Time& now, const std::string& text, const std::string& outcome,
                              const std::string& reason)
{
  state_.header.stamp = now;
  state_.stopped = actions_.stopped();
  state_.speed_limit = actions_.speedLimit(toNs(now));
  state_.text = text;
  state_.outcome = outcome;
  state_.reason = reason;
  state_publisher_.publish(state_);
}

void CommandRos::report(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const double speed_limit = actions_.speedLimit(toNs(ros::Time::now()));
  if (actions_.stopped())
  {
    status.summary(DiagnosticStatus::WARN, stop_reason_ + "; say \"go\" or call service release");
  }
  else if (command_.getNumPublishers() == 0)
  {
    status.summary(DiagnosticStatus::WARN, "nobody publishes " + command_.getTopic() +
                                               ": a spoken stop is not heard; does the recogniser run?");
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, "at most " + format("%.2f", speed_limit) + " m/s");
  }
  status.add("speed limit [m/s]", format("%.2f", speed_limit));
  status.add("last command", state_.text);
  status.add("its outcome", state_.outcome);
  status.add("its reason", state_.reason);
  status.add("commands done", done_);
  status.add("commands ignored", ignored_);
  status.add("actions_file", actions_path_);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_vehicle
