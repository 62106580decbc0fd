#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>

namespace pi_slam
{

/// Turn about z and shift between two worlds in which the same vehicle was seen, from pairs of its poses: mean heading
/// difference, then mean position difference. Roll and pitch are common to both, as gravity is. Not thread safe.
class HeadingAlignment
{
public:
  void add(const Eigen::Isometry3d& T_a_base, const Eigen::Isometry3d& T_b_base);
  size_t count() const { return count_; }
  /// @return T_a_b; identity before the first pair.
  Eigen::Isometry3d T_a_b() const;
  void clear() { *this = HeadingAlignment(); }

private:
  size_t count_ = 0;
  double sum_sine_ = 0.0;
  double sum_cosine_ = 0.0;
  Eigen::Vector3d sum_p_a_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d sum_p_b_ = Eigen::Vector3d::Zero();
};

/// Ties the frame of a recording's ground truth to map, so that both paths can be seen together: map -> world as a
/// static transform, from the poses of the first seconds on the topics odometry and ground_truth/odometry.
///
/// Parameters: ~window_s (10.0) [s] of poses that are used; ~map_frame (map).
class GroundTruthAlignmentRos
{
public:
  /// @throws std::invalid_argument for wrong parameters.
  GroundTruthAlignmentRos(ros::NodeHandle node, ros::NodeHandle private_node);

private:
  void onTruth(const nav_msgs::OdometryConstPtr& truth);
  void onOdometry(const nav_msgs::OdometryConstPtr& odometry);

  double window_s_ = 10.0;
  std::string map_frame_ = "map";
  std::deque<nav_msgs::OdometryConstPtr> truths_;  ///< of the last second
  HeadingAlignment alignment_;
  int64_t first_ns_ = 0;  ///< stamp of the first pair; 0: none
  int64_t last_ns_ = 0;   ///< of the newest odometry
  int64_t published_ns_ = 0;
  tf2_ros::Buffer tf_buffer_;
  tf2_ros::TransformListener tf_listener_;
  tf2_ros::StaticTransformBroadcaster tf_broadcaster_;
  ros::Subscriber truth_subscriber_;
  ros::Subscriber odometry_subscriber_;
};

}  // namespace pi_slam
