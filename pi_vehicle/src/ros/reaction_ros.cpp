#include "ros/reaction_ros.h"

#include "ros/decision_conversions.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <exception>
#include <limits>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t REACTION_QUEUE = 50;
constexpr char REACTION_SOURCE[] = "reaction";
constexpr double FUTURE_S = 0.1;
constexpr double CLOCK_JUMP_S = 1.0;

}  // namespace

ReactionRos::ReactionRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("reaction")
  , node_(thread_.handle(node))
  , private_node_(thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<ReactionRosOptions>(private_node, "reaction", {}, "reaction_node"))
  , rules_path_(configPath("rules_file", options_.rules_file))
  , warnings_(options_.warning_period_s, pi_node::warningLog<ReactionRosOptions>("reaction"))
  , updater_(node_, private_node, private_node.getNamespace())
  , limit_(std::numeric_limits<double>::infinity())
{
  loadRules();
  result_.speed_limit = std::numeric_limits<double>::infinity();
  motion_ = node_.advertise<MotionCommand>("motion/reaction", REACTION_QUEUE);
  events_ = node_.advertise<ReactionEvent>("reaction/events", REACTION_QUEUE);
  say_ = node_.advertise<std_msgs::String>("say", REACTION_QUEUE);
  horn_ = node_.advertise<std_msgs::Empty>("horn", REACTION_QUEUE);
  updater_.setHardwareID("none");
  updater_.add("reaction", [this](Status& status) { report(status); });

  obstacles_ = node_.subscribe("obstacles", 2, &ReactionRos::onObstacles, this, ros::TransportHints().tcpNoDelay());
  reload_ = private_node_.advertiseService("reload", &ReactionRos::onReload, this);
  timer_ = pi_node::VehicleTimer(
      node_, 1.0 / options_.rate, [this] { tick(); }, "reaction");
  diagnostic_timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

ReactionRos::~ReactionRos()
{
  thread_.stop();
}

void ReactionRos::loadRules()
{
  const ReactionRulesOptions options = ReactionRulesOptions::load(rules_path_);
  rules_ = std::make_unique<ReactionRules>(options);
  rules_options_ = options;
}

bool ReactionRos::onReload(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  try
  {
    loadRules();
    response.success = true;
    response.message = std::to_string(rules_options_.rules.size()) + " rules of " + rules_path_;
    ROS_INFO_STREAM_NAMED("reaction", "reloaded: " << response.message);
  }
  catch (const std::exception& error)
  {
    response.success = false;
    response.message = std::string("the old rules stay: ") + error.what();
    ROS_ERROR_STREAM_NAMED("reaction", response.message);
  }
  return true;
}

void ReactionRos::onObstacles(const pi_detect::ObstacleArray& message)
{
  const ros::Time now = ros::Time::now();
  std_msgs::Header header = message.header;
  if (header.stamp.isZero())
  {
    header.stamp = now;
  }
  const double age_s = (now - header.stamp).toSec();
  const double step_s = newest_.isZero() ? 0.0 : (header.stamp - newest_).toSec();
  std::string problem;
  if (header.frame_id != options_.base_link_frame)
  {
    problem = "are in frame \"" + header.frame_id + "\", must be in " + options_.base_link_frame;
  }
  else if (age_s > options_.obstacles_timeout)
  {
    problem = "are " + format("%.2f", age_s) + " s old; is detection too slow, or do the clocks differ?";
  }
  else if (age_s < -FUTURE_S)
  {
    problem = "are " + format("%.2f", -age_s) + " s from the future: check the clocks";
  }
  else if (step_s < 0.0 && step_s > -CLOCK_JUMP_S)
  {
    problem = "are older than those before; is there one publisher?";
  }
  if (!problem.empty())
  {
    ++refused_;
    warnings_.warn("obstacles refused: they " + problem);
    return;
  }
  ++arrays_;
  newest_ = header.stamp;
  run(header, toSeenThings(message, options_.max_unseen));
  decide(now, false);
}

void ReactionRos::run(const std_msgs::Header& header, const std::vector<SeenThing>& things)
{
  result_ = rules_->update(static_cast<int64_t>(header.stamp.toNSec()), things);
  for (const RuleEvent& event : result_.events)
  {
    act(event, header);
  }
}

void ReactionRos::act(const RuleEvent& event, const std_msgs::Header& header)
{
  std::string said = event.text;
  if (event.action == ReactionAction::GREET && said.empty())
  {
    said = options_.greeting;
  }
  if (!said.empty())
  {
    std_msgs::String message;
    message.data = said;
    say_.publish(message);
  }
  if (event.action == ReactionAction::HORN)
  {
    horn_.publish(std_msgs::Empty());
  }
  ++event_count_;
  last_event_ = event.rule + ": " + toString(event.action);
  ROS_INFO_STREAM_NAMED("reaction", last_event_ << " for "
                                                << (event.thing.label.empty() ? "something" : event.thing.label) << " "
                                                << event.thing.id << " at " << format("%.1f", event.thing.position.x())
                                                << ", " << format("%.1f", event.thing.position.y()) << " m");
  events_.publish(toMsg(event, header, said));
}

bool ReactionRos::silent(const ros::Time& now) const
{
  const double age_s = (now - newest_).toSec();
  return newest_.isZero() || age_s > options_.obstacles_timeout || age_s < -CLOCK_JUMP_S;
}

void ReactionRos::tick()
{
  const ros::Time now = ros::Time::now();
  if (now.isZero())
  {
    return;
  }
  if (silent(now) && now.toSec() > options_.obstacles_timeout)
  {
    // Nothing is seen. Older than any obstacles that would still be taken, so that time does not go back for these.
    std_msgs::Header header;
    header.stamp = now - ros::Duration(options_.obstacles_timeout);
    header.frame_id = options_.base_link_frame;
    run(header, {});
  }
  decide(now, true);
}

void ReactionRos::decide(const ros::Time& now, bool at_tick)
{
  double limit = result_.speed_limit;
  std::string reason = result_.reason;
  if (options_.need_obstacles && silent(now))
  {
    limit = 0.0;
    reason = newest_.isZero() ? "no obstacles heard yet"
                              : "obstacles silent for " + format("%.1f", (now - newest_).toSec()) + " s";
  }
  if (at_tick || limit < limit_)
  {
    DriveCommand command;
    command.source = REACTION_SOURCE;
    command.speed = std::min(limit, NO_SPEED_LIMIT);
    command.max_deceleration = result_.speed_limit <= 0.0 ? options_.stop_deceleration : options_.slow_deceleration;
    command.reason = reason;
    motion_.publish(toMotionCommand(command, now));
    limit_ = limit;
    reason_ = reason;
  }
}

void ReactionRos::report(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  if (silent(ros::Time::now()))
  {
    status.summary(options_.need_obstacles ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN,
                   newest_.isZero() ? "no obstacles heard yet; does pi_detect run?"
                                    : "obstacles are silent; does pi_detect run, and do its cameras?");
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK,
                   reason_.empty() ? "no limit" : "at most " + format("%.2f", limit_) + " m/s: " + reason_);
  }
  status.add("speed limit [m/s]", reason_.empty() ? "none" : format("%.2f", limit_));
  status.add("reason", reason_);
  status.add("rules", rules_options_.rules.size());
  status.add("rules_file", rules_path_);
  status.add("obstacle arrays", arrays_);
  status.add("obstacle arrays refused", refused_);
  status.add("events", event_count_);
  status.add("last event", last_event_);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_vehicle
