#include "ros/vio_initial_pose.h"

#include <pi_node/formatting.h>

#include <cmath>
#include <exception>
#include <optional>

#include "ros/conversions.h"

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;

constexpr double SHORTEST_QUATERNION = 1e-3;
constexpr size_t Z_VARIANCE = 2 * 6 + 2;
constexpr double MAX_DISTANCE_M = 1e6;

std::string withoutSlash(const std::string& frame)
{
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

/// Why a pose cannot be used, and the way out; empty: it can.
std::string poseProblem(const geometry_msgs::PoseWithCovarianceStamped& message, const std::string& map_frame)
{
  const geometry_msgs::Point& p = message.pose.pose.position;
  const geometry_msgs::Quaternion& q = message.pose.pose.orientation;
  if (withoutSlash(message.header.frame_id) != map_frame)
  {
    return "is in frame \"" + message.header.frame_id + "\", must be in " + map_frame +
           " (map_frame); in rviz set the fixed frame to it";
  }
  const double length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  const double distance = std::sqrt(p.x * p.x + p.y * p.y + p.z * p.z);
  if (!std::isfinite(length) || !(distance < MAX_DISTANCE_M))
  {
    return "has numbers that are not finite, or is beyond 1000 km; send a pose";
  }
  if (length < SHORTEST_QUATERNION)
  {
    return "has a quaternion of length " + format("%.3g", length) + ", must be 1; no turn is [0, 0, 0, 1]";
  }
  return "";
}

/// Position and heading of the message; roll and pitch of odometry.
Eigen::Isometry3d posePart(const geometry_msgs::PoseWithCovariance& pose, const Eigen::Isometry3d& T_map_odom,
                           const Eigen::Isometry3d& T_odom_base)
{
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  const geometry_msgs::Quaternion& q = pose.pose.orientation;
  const geometry_msgs::Point& p = pose.pose.position;
  T_map_base.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  T_map_base.translation() = Eigen::Vector3d(p.x, p.y, p.z);
  if (!(pose.covariance[Z_VARIANCE] > 0.0))
  {
    T_map_base.translation().z() = (T_map_odom * T_odom_base).translation().z();
  }
  // Of the base, not the body: the message knows only the base's heading and place, its roll and pitch may be wrong.
  const Eigen::Matrix3d R = T_map_base.linear() * T_odom_base.linear().transpose();
  T_map_base.linear() = Eigen::AngleAxisd(std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1)), Eigen::Vector3d::UnitZ()) *
                        T_odom_base.linear();
  return T_map_base;
}

}  // namespace

VioInitialPose::VioInitialPose(const VioRosOptions& options, ros::NodeHandle node, VioSession* session,
                               pi_node::WarningBoard* warnings)
  : options_(options)
  , session_(*session)
  , warnings_(*warnings)
  , topic_(node.resolveName("initialpose"))
  , subscriber_(node.subscribe("initialpose", 1, &VioInitialPose::onPose, this))
{
}

void VioInitialPose::onPose(const geometry_msgs::PoseWithCovarianceStampedConstPtr& message)
{
  std::string problem = poseProblem(*message, options_.map_frame);
  const int64_t stamp_ns = problem.empty() ? fromMsg(message->header.stamp) : 0;
  const VioSession::Place place = session_.placeAt(stamp_ns);
  if (problem.empty() && (!place.pipeline || !place.newest_odom_base))
  {
    problem = "came before there is odometry; send it again when there is";
  }
  if (!problem.empty())
  {
    warnings_.warn(topic_ + ": the pose " + problem + "; ignored");
    return;
  }
  Eigen::Isometry3d T_odom_base = place.newest_odom_base->second;
  std::string by = stamp_ns == 0
                       ? "the newest odometry, as it has no stamp"
                       : "the newest odometry, " + format("%.3f", seconds(place.newest_odom_base->first - stamp_ns)) +
                             " s from its stamp, of which none is known";
  if (place.T_odom_base)
  {
    T_odom_base = *place.T_odom_base;
    by = "odometry of its stamp";
  }
  const Eigen::Isometry3d T_map_base = posePart(message->pose, place.T_map_odom, T_odom_base);
  try
  {
    if (place.pipeline->mapper)
    {
      const Eigen::Isometry3d& T_base_body = place.pipeline->T_base_body;
      place.pipeline->mapper->setPose(T_odom_base * T_base_body, T_map_base * T_base_body);
    }
    session_.setMapPlace(place, T_map_base * T_odom_base.inverse());
  }
  catch (const std::exception& error)
  {
    warnings_.error(topic_ + ": " + error.what());
    return;
  }
  const Eigen::Vector3d moved = T_map_base.translation() - (place.T_map_odom * T_odom_base).translation();
  const geometry_msgs::Point& p = message->pose.pose.position;
  ROS_INFO_STREAM_NAMED("vio", topic_ << ": " << options_.base_link_frame << " is at x " << format("%.2f", p.x)
                                      << ", y " << format("%.2f", p.y) << ", by " << by << "; moved by "
                                      << format("%.2f", moved.norm()) << " m");
}

}  // namespace pi_slam
