// A pose that somebody says, on vio_service.

#include <pi_node/formatting.h>
#include "ros/conversions.h"
#include "ros/vio_ros.h"

#include <algorithm>
#include <cmath>

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

}  // namespace

void VioRos::onInitialPose(const geometry_msgs::PoseWithCovarianceStampedConstPtr& message)
{
  const std::string topic = output_node_.resolveName("initialpose");
  std::string problem = poseProblem(*message, options_.map_frame);
  PipelinePtr pipeline;
  uint64_t generation = 0;
  std::optional<Eigen::Isometry3d> T_odom_base;
  Eigen::Isometry3d T_map_odom_before;
  std::string by = "odometry of its stamp";
  if (problem.empty())
  {
    std::lock_guard<std::mutex> lock(mutex_);
    pipeline = pipeline_;
    generation = generation_;
    T_map_odom_before = T_map_odom_;
    const int64_t stamp_ns = fromMsg(message->header.stamp);
    const auto newest = odom_history_.newest();
    T_odom_base = odom_history_.at(stamp_ns);
    if (!T_odom_base && newest)
    {
      T_odom_base = newest->second;
      by = stamp_ns == 0 ? "the newest odometry, as it has no stamp"
                         : "the newest odometry, " + format("%.3f", seconds(newest->first - stamp_ns)) +
                               " s from its stamp, of which none is known";
    }
    if (!pipeline || !T_odom_base)
    {
      problem = "came before there is odometry; send it again when there is";
    }
  }
  if (!problem.empty())
  {
    warnings_.warn(topic + ": the pose " + problem + "; ignored");
    return;
  }

  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  const geometry_msgs::Quaternion& q = message->pose.pose.orientation;
  const geometry_msgs::Point& p = message->pose.pose.position;
  T_map_base.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  T_map_base.translation() = Eigen::Vector3d(p.x, p.y, p.z);
  if (!(message->pose.covariance[Z_VARIANCE] > 0.0))
  {
    T_map_base.translation().z() = (T_map_odom_before * *T_odom_base).translation().z();
  }
  // Of the base, not the body: only the base's heading and place are said, and its roll and pitch may be wrong.
  const Eigen::Matrix3d R = T_map_base.linear() * T_odom_base->linear().transpose();
  T_map_base.linear() = Eigen::AngleAxisd(std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1)), Eigen::Vector3d::UnitZ()) *
                        T_odom_base->linear();
  try
  {
    if (pipeline->mapper)
    {
      pipeline->mapper->setPose(*T_odom_base * pipeline->T_base_body, T_map_base * pipeline->T_base_body);
    }
    std::lock_guard<std::mutex> lock(mutex_);
    if (generation_ == generation)
    {
      T_map_odom_ = pipeline->mapper ? pipeline->mapper->T_map_odom() : T_map_base * T_odom_base->inverse();
    }
  }
  catch (const std::exception& error)
  {
    warnings_.error(topic + ": " + error.what());
    return;
  }
  const Eigen::Vector3d moved = T_map_base.translation() - (T_map_odom_before * *T_odom_base).translation();
  ROS_INFO_STREAM_NAMED("vio", topic << ": " << options_.base_link_frame << " is at x " << format("%.2f", p.x) << ", y "
                                     << format("%.2f", p.y) << ", by " << by << "; moved by "
                                     << format("%.2f", moved.norm()) << " m");
}

}  // namespace pi_slam
