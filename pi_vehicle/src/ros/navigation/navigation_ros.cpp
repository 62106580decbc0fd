#include "ros/navigation/navigation_ros.h"

#include "ros/decision_conversions.h"
#include "ros/navigation/kept_goal.h"
#include "ros/navigation/navigation_conversions.h"

#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>

#include <cmath>
#include <vector>

namespace pi_vehicle
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

namespace
{

constexpr double SLOW_RATE_HZ = 5.0;  // of feedback and markers
constexpr double ROUTE_STEP = 0.25;   // between poses of the published route [m]

}  // namespace

NavigationRos::NavigationRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("navigation")
  , service_node_(service_thread_.handle(node))
  , private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<NavigationRosOptions>(private_node, "navigation", {KEPT_GOAL}))
  , warnings_(options_.warning_period_s, pi_node::warningLog<NavigationRosOptions>("navigation"))
  , updater_(service_node_, private_node, private_node.getNamespace())
  , navigator_(options_.navigator)
  , inputs_(service_node_, options_)
  , goals_(service_node_, private_node_, options_, inputs_, &navigator_, &warnings_)
{
  motion_ = service_node_.advertise<MotionCommand>("motion/navigation", 1);
  route_ = service_node_.advertise<nav_msgs::Path>("route", 1, true);
  markers_ = private_node_.advertise<visualization_msgs::MarkerArray>("markers", 1);
  updater_.setHardwareID("none");
  updater_.add("navigation", [this](Status& status) { report(status); });
  publishRoute(ros::Time::now());
  obstacle_subscriber_ =
      service_node_.subscribe("obstacles", 2, &NavigationRos::onObstacles, this, ros::TransportHints().tcpNoDelay());
  const auto subscribeGrid = [this](const char* topic, bool whole_map)
  {
    return service_node_.subscribe<nav_msgs::OccupancyGrid>(
        topic, 1, [this, whole_map](const nav_msgs::OccupancyGridConstPtr& message) { onGrid(message, whole_map); });
  };
  grid_subscriber_ = subscribeGrid("grid", false);
  map_subscriber_ = subscribeGrid("map", true);
  goals_.start();
  timer_ = pi_node::VehicleTimer(
      service_node_, 1.0 / options_.rate_hz, [this] { update(); }, "navigation");
  diagnostic_timer_ =
      pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  service_thread_.start();
}

NavigationRos::~NavigationRos()
{
  service_thread_.stop();
  timer_.stop();
  diagnostic_timer_.stop();
  goals_.abort("the navigation ended; send the goal again when it is back");
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

void NavigationRos::onGrid(const nav_msgs::OccupancyGridConstPtr& message, bool whole_map)
{
  const ros::Subscriber& subscriber = whole_map ? map_subscriber_ : grid_subscriber_;
  std::string problem;
  const auto T_map_frame = inputs_.mapFrom(message->header.frame_id, false, &problem);
  if (!T_map_frame)
  {
    warnings_.warn(subscriber.getTopic() + ": " + problem);
    return;
  }
  const std::optional<GroundGrid> grid = toGroundGrid(message, *T_map_frame);
  if (!grid)
  {
    warnings_.error(subscriber.getTopic() + ": size, resolution or origin do not agree with its " +
                    std::to_string(message->data.size()) + " cells; left out");
    return;
  }
  if (whole_map)
  {
    navigator_.setMap(*grid);
  }
  else
  {
    navigator_.setGround(*grid);
  }
}

void NavigationRos::update()
{
  const ros::Time now = ros::Time::now();
  output_ = navigator_.update(inputs_.at(now));
  motion_.publish(toMotionCommand(output_.command, now));
  if (output_.path_changed)
  {
    publishRoute(now);
  }
  goals_.onUpdate(output_, now);
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
  goals_.publishFeedback(output_);
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
  const NavigatorInput known = inputs_.at(ros::Time::now());
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
  status.add("goal before", goals_.lastEnd().empty() ? "none" : goals_.lastEnd());
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
  status.add("vehicle", !inputs_.vehicleHeard()         ? "nothing heard yet"
                        : known.vehicle_problem.empty() ? "drives when told to"
                                                        : known.vehicle_problem);
}

}  // namespace pi_vehicle
