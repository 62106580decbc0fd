#pragma once

#include "decision/navigator.h"
#include "ros/navigation/navigation_ros_options.h"

#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_vehicle/LocalisationState.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <optional>
#include <string>

namespace pi_vehicle
{

/// Holds the newest message of every input but the obstacles, and makes a NavigatorInput from them. Not thread safe:
/// callbacks and calls belong to the thread of the node handle's queue.
class NavigationInputs
{
public:
  NavigationInputs(ros::NodeHandle node, const NavigationRosOptions& options);

  NavigatorInput at(const ros::Time& now) const;
  /// The newest transform from a frame into the map. @return nullopt, with the problem set, if unknown or, unless
  /// `may_be_old`, older than tf_timeout_s.
  std::optional<Eigen::Isometry3d> mapFrom(const std::string& frame, bool may_be_old, std::string* problem) const;
  bool vehicleHeard() const { return vehicle_ != nullptr; }
  /// Measured [m/s]; 0 before the first message.
  double vehicleSpeed() const { return vehicle_ ? vehicle_->speed : 0.0; }

private:
  void addPose(NavigatorInput* input) const;

  const NavigationRosOptions& options_;
  tf2_ros::Buffer tf_buffer_;
  tf2_ros::TransformListener tf_listener_;
  nav_msgs::OdometryConstPtr odometry_;
  geometry_msgs::PoseWithCovarianceStampedConstPtr map_pose_;  ///< none: odometry alone tells the deviation
  VehicleStateConstPtr vehicle_;
  ros::Time vehicle_came_;
  LocalisationStateConstPtr localisation_;  ///< of the pose keeper; none: there is no keeper
  ros::Subscriber odometry_subscriber_;
  ros::Subscriber map_pose_subscriber_;
  ros::Subscriber vehicle_subscriber_;
  ros::Subscriber localisation_subscriber_;
};

}  // namespace pi_vehicle
