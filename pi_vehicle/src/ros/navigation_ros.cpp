#include "ros/decision_conversions.h"
#include "ros/kept_goal.h"
#include "ros/navigation_conversions.h"
#include "ros/navigation_ros.h"
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <tf2/exceptions.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr double SLOW_RATE_HZ = 5.0;  // of feedback and markers
constexpr double ROUTE_STEP = 0.25;   // between poses of the published route [m]
constexpr double NO_TURN = 1e-9;      // quaternions that are shorter have none

int64_t toNs(const ros::Time& time)
{
  return static_cast<int64_t>(time.toNSec());
}

std::string withoutSlash(const std::string& frame)
{
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

}  // namespace

NavigationRos::NavigationRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("navigation")
  , service_node_(service_thread_.handle(node))
  , private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<NavigationRosOptions>(private_node, "navigation"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<NavigationRosOptions>("navigation"))
  , updater_(service_node_, private_node, private_node.getNamespace())
  , navigator_(options_.navigator)
  , kept_(private_node)
  , tf_listener_(tf_buffer_, service_node_, false, ros::TransportHints().tcpNoDelay())
{
  motion_ = service_node_.advertise<MotionCommand>("motion/navigation", 1);
  route_ = service_node_.advertise<nav_msgs::Path>("route", 1, true);
  markers_ = private_node_.advertise<visualization_msgs::MarkerArray>("markers", 1);
  updater_.setHardwareID("none");
  updater_.add("navigation", [this](Status& status) { report(status); });
  publishRoute(ros::Time::now());

  // Of each the newest counts.
  const auto hints = ros::TransportHints().tcpNoDelay();
  odometry_subscriber_ = service_node_.subscribe<nav_msgs::Odometry>(
      "odometry", 1, [this](const nav_msgs::OdometryConstPtr& message) { odometry_ = message; }, ros::VoidConstPtr(),
      hints);
  map_pose_subscriber_ = service_node_.subscribe<geometry_msgs::PoseWithCovarianceStamped>(
      "map_pose", 1, [this](const geometry_msgs::PoseWithCovarianceStampedConstPtr& message) { map_pose_ = message; },
      ros::VoidConstPtr(), hints);
  vehicle_subscriber_ = service_node_.subscribe("vehicle_state", 1, &NavigationRos::onVehicleState, this, hints);
  localisation_subscriber_ = service_node_.subscribe<LocalisationState>(
      "localisation", 1, [this](const LocalisationStateConstPtr& message) { localisation_ = message; },
      ros::VoidConstPtr(), hints);
  obstacle_subscriber_ = service_node_.subscribe("obstacles", 2, &NavigationRos::onObstacles, this, hints);
  goal_subscriber_ = service_node_.subscribe("goal", 2, &NavigationRos::onGoal, this);
  cancel_ = private_node_.advertiseService("cancel", &NavigationRos::onCancelService, this);
  server_ = std::make_unique<ActionServer>(
      service_node_, "drive", [this](GoalHandle handle) { onDrive(handle); },
      [this](GoalHandle handle) { onCancel(handle); }, false);
  server_->start();
  resumeGoal();
  timer_ = service_node_.createSteadyTimer(ros::WallDuration(1.0 / options_.rate_hz),
                                           [this](const ros::SteadyTimerEvent&) { update(); });
  diagnostic_timer_ = service_node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                                    [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  service_thread_.start();
}

NavigationRos::~NavigationRos()
{
  service_thread_.stop();
  timer_.stop();
  diagnostic_timer_.stop();
  kept_.keep(KEPT_GOAL, std::string());
  endAction(DriveEnd::FAILED, "the navigation ended; send the goal again when it is back");
}

// ------------------------------------------------------------------------------------------------------------- inputs

void NavigationRos::onVehicleState(const VehicleStateConstPtr& message)
{
  vehicle_ = message;
  vehicle_came_ = ros::Time::now();
}

void NavigationRos::onObstacles(const pi_detect::ObstacleArrayConstPtr& message)
{
  if (withoutSlash(message->header.frame_id) != options_.base_link_frame)
  {
    warnings_.error("obstacles are in frame \"" + message->header.frame_id + "\", must be in " +
                    options_.base_link_frame + " (base_link_frame); left out");
    return;
  }
  obstacles_ = message;
  const std::string left_out =
      navigator_.setObstacles(toNs(message->header.stamp), toObstacleBoxes(*message), toNs(ros::Time::now()));
  if (!left_out.empty())
  {
    warnings_.warn(left_out);
  }
}

std::optional<Eigen::Isometry3d> NavigationRos::mapFrom(const std::string& given, bool may_be_old,
                                                        std::string* problem) const
{
  const std::string frame = withoutSlash(given);
  if (frame == options_.map_frame)
  {
    return Eigen::Isometry3d::Identity();
  }
  try
  {
    const geometry_msgs::TransformStamped transform =
        tf_buffer_.lookupTransform(options_.map_frame, frame, ros::Time(0));
    const double age_s = transform.header.stamp.isZero() ? 0.0 : (ros::Time::now() - transform.header.stamp).toSec();
    if (may_be_old || age_s <= options_.tf_timeout_s)
    {
      return toIsometry(transform.transform);
    }
    *problem = "tf " + options_.map_frame + " -> " + frame +
               " is older than tf_timeout_s = " + format("%g", options_.tf_timeout_s) +
               " s; does the localisation run?";
  }
  catch (const tf2::TransformException&)
  {
    *problem = "tf has no " + options_.map_frame + " -> " + frame +
               (may_be_old ? "; give the goal in a frame that tf knows" : "; does the localisation run?");
  }
  return std::nullopt;
}

NavigatorInput NavigationRos::input(const ros::Time& now) const
{
  NavigatorInput input;
  input.now_ns = toNs(now);
  if (vehicle_)
  {
    input.vehicle_ns = std::max<int64_t>(1, toNs(vehicle_came_));
    input.speed = vehicle_->speed;
    input.curvature = vehicle_->curvature;
    input.vehicle_problem = vehicleProblem(*vehicle_);
  }
  if (localisation_ && !localisation_->valid)
  {
    input.pose_problem = "localisation is not valid: " + localisation_->reason;
    return input;
  }
  if (!odometry_)
  {
    input.pose_problem = "nothing came on " + odometry_subscriber_.getTopic() + " yet; does the localisation run?";
    return input;
  }
  const nav_msgs::Odometry& odometry = *odometry_;
  const geometry_msgs::Quaternion& q = odometry.pose.pose.orientation;
  if (!odometry.child_frame_id.empty() && withoutSlash(odometry.child_frame_id) != options_.base_link_frame)
  {
    input.pose_problem = "odometry is of frame " + odometry.child_frame_id + ", must be of " +
                         options_.base_link_frame + " (base_link_frame)";
  }
  else if (std::hypot(std::hypot(q.x, q.y), std::hypot(q.z, q.w)) < NO_TURN)
  {
    input.pose_problem = "odometry has no orientation: its quaternion is 0";
  }
  else if (const auto T_map_odom = mapFrom(odometry.header.frame_id, false, &input.pose_problem))
  {
    input.pose = toPose2(*T_map_odom * toIsometry(odometry.pose.pose));
    input.pose_stamp_ns = toNs(odometry.header.stamp);
    input.position_deviation = positionDeviation(odometry.pose);
    // Odometry knows its way from the start only; the map also the places that it recognised since.
    if (map_pose_ && std::abs((odometry.header.stamp - map_pose_->header.stamp).toSec()) <= options_.tf_timeout_s)
    {
      const double in_map = positionDeviation(map_pose_->pose);
      const bool better = in_map > 0.0 && (input.position_deviation == 0.0 || in_map < input.position_deviation);
      input.position_deviation = better ? in_map : input.position_deviation;
    }
  }
  return input;
}

// ------------------------------------------------------------------------------------------------------------ outputs

void NavigationRos::update()
{
  const ros::Time now = ros::Time::now();
  output_ = navigator_.update(input(now));
  motion_.publish(toMotionCommand(output_.command, now));
  if (output_.path_changed)
  {
    publishRoute(now);
  }
  if (output_.end != DriveEnd::NONE)
  {
    endAction(output_.end, output_.command.reason);
    last_end_ = output_.command.reason;
    kept_.keep(KEPT_GOAL, std::string());
  }
  else if (navigator_.active())
  {
    keepGoal(now);
  }
  logState();
  if (++slow_count_ >= static_cast<unsigned>(std::lround(options_.rate_hz / SLOW_RATE_HZ)))
  {
    slow_count_ = 0;
    publishSlowly();
  }
}

void NavigationRos::publishRoute(const ros::Time& now)
{
  route_.publish(toMsg(navigator_.path(), ROUTE_STEP, now, options_.map_frame));
}

void NavigationRos::publishSlowly()
{
  if (action_)
  {
    action_->publishFeedback(toFeedback(output_, vehicle_ ? vehicle_->speed : 0.0));
  }
  if (markers_.getNumSubscribers() > 0)
  {
    markers_.publish(toMarkers({options_.map_frame, options_.base_link_frame, navigator_.wayAhead(),
                                navigator_.lookAhead(), obstacles_, output_}));
  }
}

void NavigationRos::logState()
{
  const std::string& reason = output_.command.reason;
  if (output_.end != DriveEnd::NONE)
  {
    if (output_.end == DriveEnd::FAILED)
    {
      ROS_ERROR_STREAM_NAMED("navigation", "goal given up: " << reason);
    }
    else
    {
      ROS_INFO_STREAM_NAMED("navigation", "goal ended: " << reason);
    }
  }
  else if (output_.state != logged_state_)
  {
    if (output_.state == NavigatorState::STOPPED)
    {
      warnings_.warn("stopped: " + reason);
    }
    else
    {
      ROS_INFO_STREAM_THROTTLE_NAMED(1.0, "navigation", toString(output_.state) << ": " << reason);
    }
  }
  logged_state_ = output_.state;
}

void NavigationRos::report(Status& status) const
{
  const NavigatorInput known = input(ros::Time::now());
  const bool trouble = output_.state == NavigatorState::STOPPED || output_.state == NavigatorState::WAITING;
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  status.summary(trouble ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                 std::string(toString(output_.state)) + ": " + output_.command.reason);
  if (!trouble && !warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  status.add("state", toString(output_.state));
  status.add("reason", output_.command.reason);
  status.add("goal before", last_end_.empty() ? "none" : last_end_);
  status.add("distance to goal [m]", format("%.1f", output_.distance_to_goal));
  status.add("progress [%]", format("%.0f", 100.0 * output_.progress));
  status.add("cross-track error [m]", format("%.2f", output_.cross_track));
  status.add("speed limit [m/s]", format("%.2f", output_.speed_limit));
  status.add("speed limit set by", output_.limited_by.empty() ? "nothing drives" : output_.limited_by);
  status.add("obstacle", output_.obstacle_id);
  status.add("time to collision [s]", format("%.1f", output_.time_to_collision));
  status.add("localisation", !known.pose ? known.pose_problem
                             : known.position_deviation == 0.0
                                 ? "known"
                                 : "known to" + format(" %.2f m", known.position_deviation));
  status.add("vehicle", !vehicle_                       ? "nothing heard yet"
                        : known.vehicle_problem.empty() ? "drives when told to"
                                                        : known.vehicle_problem);
}

}  // namespace pi_vehicle
