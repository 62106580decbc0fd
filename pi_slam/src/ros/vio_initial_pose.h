#pragma once

#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <string>

#include "ros/vio_session.h"

namespace pi_slam
{

/// Subscribes to `initialpose`: base_link was at a pose of the map at a stamp. T_map_odom becomes so; odometry stays.
///
/// Odometry of that stamp is used where it is still known (5 s), else (stamp 0, older, newer, or before odometry began
/// anew) the newest. Position and heading of the pose are taken; z only if its variance is above 0, as rviz's 2D Pose
/// Estimate has none.
class VioInitialPose
{
public:
  /// The callback comes on the queue of the handle. The other arguments outlive it.
  VioInitialPose(const VioRosOptions& options, ros::NodeHandle node, VioSession* session,
                 pi_node::WarningBoard* warnings);

private:
  void onPose(const geometry_msgs::PoseWithCovarianceStampedConstPtr& message);

  const VioRosOptions& options_;
  VioSession& session_;
  pi_node::WarningBoard& warnings_;
  const std::string topic_;
  ros::Subscriber subscriber_;
};

}  // namespace pi_slam
