#include "ros/pose_keeper_ros.h"

#include "decision/saved_pose_file.h"
#include "ros/decision_conversions.h"
#include "ros/navigation/navigation_conversions.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_vehicle/LocalisationState.h>
#include <tf2/exceptions.h>

#include <algorithm>
#include <cmath>
#include <exception>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr double PERIOD_S = 0.02;
constexpr double FILE_PERIOD_S = 1.0;
constexpr double SAVED_M = 0.01;  // changes that are worth writing
constexpr double SAVED_RAD = 0.003;
constexpr double STANDS = 0.05;             // [m/s]
constexpr int64_t MAP_PERIOD_NS = 5000000;  // between two looks at tf
constexpr size_t CONNECTIONS = 4;
constexpr double MIN_NORM = 1e-9;  // quaternions that are shorter have none
constexpr size_t COLUMNS = 6;

geometry_msgs::PoseWithCovarianceStamped toMsg(const KeptPose& kept, const std::string& map_frame)
{
  geometry_msgs::PoseWithCovarianceStamped message;
  message.header.stamp.fromNSec(static_cast<uint64_t>(std::max<int64_t>(0, kept.stamp_ns)));
  message.header.frame_id = map_frame;
  const Eigen::Vector3d p = kept.T_map_base.translation();
  const Eigen::Quaterniond q(kept.T_map_base.linear());
  message.pose.pose.position.x = p.x();
  message.pose.pose.position.y = p.y();
  message.pose.pose.position.z = p.z();
  message.pose.pose.orientation.x = q.x();
  message.pose.pose.orientation.y = q.y();
  message.pose.pose.orientation.z = q.z();
  message.pose.pose.orientation.w = q.w();
  for (size_t i = 0; i < COLUMNS; ++i)
  {
    const double deviation = i < 3 ? kept.position_deviation : kept.heading_deviation;
    message.pose.covariance[i * COLUMNS + i] = deviation * deviation;
  }
  return message;
}

}  // namespace

PoseKeeperRos::PoseKeeperRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("pose_keeper")
  , service_node_(service_thread_.handle(node))
  , options_(pi_node::loadNodeOptions<PoseKeeperRosOptions>(private_node, "pose_keeper"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<PoseKeeperRosOptions>("pose_keeper"))
  , updater_(service_node_, private_node, private_node.getNamespace())
  , keeper_(options_.keeper)
  , tf_listener_(tf_buffer_, service_node_, false, ros::TransportHints().tcpNoDelay())
{
  if (options_.resume)
  {
    try
    {
      if (const auto saved = readSavedPose(options_.file, options_.map_frame, options_.max_file_age_s))
      {
        keeper_.resume(*saved);
        ROS_INFO_STREAM_NAMED("pose_keeper", "may go on from the pose in " << options_.file << ", "
                                                                           << format("%.0f", saved->age_s) << " s old");
      }
      else
      {
        ROS_INFO_STREAM_NAMED("pose_keeper", options_.file << " is not there yet: nothing to go on from");
      }
    }
    catch (const std::exception& error)
    {
      file_problem_ = std::string(error.what()) + "; not gone on from it";
      warnings_.warn(file_problem_);
    }
  }
  initial_pose_ = service_node_.advertise<geometry_msgs::PoseWithCovarianceStamped>("initialpose", 2);
  localisation_ = pi_node::LatchedPublisher<LocalisationState>(service_node_, "localisation", 1);
  updater_.setHardwareID("none");
  updater_.add("pose", [this](Status& status) { report(status); });
  told_valid_ = true;
  tell();

  const auto hints = ros::TransportHints().tcpNoDelay();
  odometry_ = service_node_.subscribe("odometry", 200, &PoseKeeperRos::onOdometry, this, hints);
  wheels_ = service_node_.subscribe("wheel_odometry", 50, &PoseKeeperRos::onWheels, this, hints);
  timer_ = pi_node::VehicleTimer(
      service_node_, PERIOD_S, [this] { update(); }, "pose_keeper");
  file_timer_ = pi_node::VehicleTimer(service_node_, FILE_PERIOD_S, [this] { save(); });
  diagnostic_timer_ =
      pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  service_thread_.start();
}

PoseKeeperRos::~PoseKeeperRos()
{
  service_thread_.stop();
  timer_.stop();
  file_timer_.stop();
  diagnostic_timer_.stop();
  save();
}

uint64_t PoseKeeperRos::connectionOf(const ros::MessageEvent<nav_msgs::Odometry const>& event)
{
  const auto& header = event.getConnectionHeaderPtr();
  for (const auto& [known, number] : connections_)
  {
    if (known == header)
    {
      return number;
    }
  }
  if (connections_.size() == CONNECTIONS)
  {
    connections_.erase(connections_.begin());
  }
  connections_.emplace_back(header, ++last_connection_);
  return last_connection_;
}

void PoseKeeperRos::onOdometry(const ros::MessageEvent<nav_msgs::Odometry const>& event)
{
  const nav_msgs::Odometry& message = *event.getConstMessage();
  const geometry_msgs::Quaternion& q = message.pose.pose.orientation;
  if (!message.child_frame_id.empty() && withoutSlash(message.child_frame_id) != options_.base_link_frame)
  {
    warnings_.error("odometry is of frame \"" + message.child_frame_id + "\", must be of " + options_.base_link_frame +
                    " (base_link_frame); left out");
    return;
  }
  if (!(std::hypot(std::hypot(q.x, q.y), std::hypot(q.z, q.w)) > MIN_NORM))
  {
    warnings_.error("odometry has no orientation: its quaternion is 0 or not finite; left out");
    return;
  }
  OdometryPose odometry;
  odometry.stamp_ns = toNs(message.header.stamp);
  odometry.T_odom_base = toIsometry(message.pose.pose);
  odometry.speed = message.twist.twist.linear.x;
  odometry.connection = connectionOf(event);
  odometry.count = message.header.seq;
  lookUpMap(message);
  const std::string problem = keeper_.addOdometry(odometry, toNs(ros::Time::now()));
  if (!problem.empty())
  {
    warnings_.warn(problem);
  }
  tell();
}

void PoseKeeperRos::lookUpMap(const nav_msgs::Odometry& odometry)
{
  const int64_t stamp_ns = toNs(odometry.header.stamp);
  if (std::abs(stamp_ns - map_looked_up_ns_) < MAP_PERIOD_NS)
  {
    return;
  }
  map_looked_up_ns_ = stamp_ns;
  try
  {
    const geometry_msgs::TransformStamped transform =
        tf_buffer_.lookupTransform(options_.map_frame, withoutSlash(odometry.header.frame_id), ros::Time(0));
    // What is static holds at any time.
    keeper_.addMapTransform(transform.header.stamp.isZero() ? stamp_ns : toNs(transform.header.stamp),
                            toIsometry(transform.transform));
  }
  catch (const tf2::TransformException&)
  {
    // The keeper waits, and says so.
  }
}

void PoseKeeperRos::onWheels(const nav_msgs::OdometryConstPtr& message)
{
  const Pose2 pose = toPose2(toIsometry(message->pose.pose));
  if (!keeper_.addWheels(toNs(message->header.stamp), pose, message->twist.twist.linear.x,
                         message->twist.twist.angular.z))
  {
    warnings_.error(wheels_.getTopic() + " has numbers that are not finite; left out");
  }
}

void PoseKeeperRos::update()
{
  const std::optional<KeptPose> pose = keeper_.update(toNs(ros::Time::now()));
  if (pose)
  {
    initial_pose_.publish(toMsg(*pose, options_.map_frame));
    ROS_INFO_STREAM_NAMED("pose_keeper", "tells odometry that it is at x "
                                             << format("%.2f", pose->T_map_base.translation().x()) << ", y "
                                             << format("%.2f", pose->T_map_base.translation().y()) << ", known to "
                                             << format("%.2f", pose->position_deviation) << " m");
  }
  tell();
}

void PoseKeeperRos::tell()
{
  if (keeper_.state() != told_state_)
  {
    const std::string text = std::string(toString(keeper_.state())) + ": " + keeper_.reason();
    if (keeper_.state() == KeeperState::LOST)
    {
      warnings_.error(text);
    }
    else
    {
      ROS_INFO_STREAM_NAMED("pose_keeper", text);
    }
    told_state_ = keeper_.state();
  }
  if (keeper_.valid() != told_valid_)
  {
    told_valid_ = keeper_.valid();
    LocalisationState message;
    message.header.stamp = ros::Time::now();
    message.header.frame_id = options_.map_frame;
    message.valid = told_valid_;
    message.reason = keeper_.reason();
    localisation_.publish(message);
  }
}

void PoseKeeperRos::save()
{
  const std::optional<SavedPose> pose = options_.file.empty() ? std::nullopt : keeper_.toSave();
  if (!pose)
  {
    return;
  }
  if (saved_)
  {
    const Eigen::Isometry3d moved = saved_->T_map_base.inverse() * pose->T_map_base;
    const bool stands = std::abs(pose->speed) < STANDS && std::abs(saved_->speed) < STANDS;
    if (stands && moved.translation().norm() < SAVED_M && Eigen::AngleAxisd(moved.linear()).angle() < SAVED_RAD)
    {
      return;
    }
  }
  try
  {
    writeSavedPose(options_.file, options_.map_frame, *pose);
    saved_ = std::make_unique<SavedPose>(*pose);
    file_problem_.clear();
  }
  catch (const std::exception& error)
  {
    file_problem_ = error.what();
    warnings_.error(file_problem_);
  }
}

void PoseKeeperRos::report(Status& status) const
{
  const std::string text = std::string(toString(keeper_.state())) + ": " + keeper_.reason();
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  status.summary(keeper_.state() == KeeperState::LOST ? DiagnosticStatus::ERROR
                 : keeper_.valid()                    ? DiagnosticStatus::OK
                                                      : DiagnosticStatus::WARN,
                 text);
  if (keeper_.valid() && !file_problem_.empty())
  {
    status.summary(DiagnosticStatus::WARN, file_problem_);
  }
  else if (keeper_.valid() && !keeper_.wheelsTrusted())
  {
    status.summary(DiagnosticStatus::WARN, "wheels and odometry differ by " +
                                               format("%.0f", 100.0 * keeper_.wheelDisagreement()) +
                                               " % of the way; check wheel radius, ticks and slip");
  }
  else if (keeper_.valid() && !warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  const std::optional<KeptPose> pose = keeper_.pose();
  status.add("state", toString(keeper_.state()));
  if (pose)
  {
    const Pose2 place = toPose2(pose->T_map_base);
    status.add("x [m]", format("%.2f", place.x));
    status.add("y [m]", format("%.2f", place.y));
    status.add("heading [rad]", format("%.3f", place.heading));
    status.add("known to [m]", format("%.2f", pose->position_deviation));
  }
  status.add("times that odometry began anew", keeper_.restarts());
  status.add("poses told", keeper_.told());
  status.add("wheels and odometry differ by [%]", format("%.1f", 100.0 * keeper_.wheelDisagreement()));
  status.add("file", options_.file.empty() ? "none" : options_.file);
}

}  // namespace pi_vehicle
