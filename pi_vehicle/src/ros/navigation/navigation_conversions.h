#pragma once

#include "decision/navigator.h"

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovariance.h>
#include <geometry_msgs/Transform.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_vehicle/DriveFeedback.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// Maps coordinates of the child frame into the parent; its quaternion is normalised, one of length 0 means no turn.
/// Numbers that are not finite stay so.
Eigen::Isometry3d toIsometry(const geometry_msgs::Transform& transform);
Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose);
/// x, y, and the heading of the x axis.
Pose2 toPose2(const Eigen::Isometry3d& pose);
/// In the map; a quaternion of length 0 means that any heading will do.
Waypoint toWaypoint(const geometry_msgs::Pose& pose, const Eigen::Isometry3d& T_map_pose_frame);

/// The inverse; without a heading the quaternion is 0.
geometry_msgs::PoseStamped toMsg(const Waypoint& waypoint, const std::string& map_frame);

/// One sigma of the position on the ground along its worst direction [m]; 0: the covariance says nothing.
double positionDeviation(const geometry_msgs::PoseWithCovariance& pose);
/// Why the vehicle will not drive; empty: it will.
std::string vehicleProblem(const VehicleState& state);
/// With their outlines, where they have one.
std::vector<ObstacleBox> toObstacleBoxes(const pi_detect::ObstacleArray& obstacles);

/// The message's cells, not a copy. @return nullopt for a message whose numbers do not agree.
std::optional<GroundGrid> toGroundGrid(const nav_msgs::OccupancyGridConstPtr& message,
                                       const Eigen::Isometry3d& T_map_frame);

/// A pose about every `step` [m]; of a closed path the first comes again at the end. Empty paths have no poses.
nav_msgs::Path toMsg(const Path& path, double step, const ros::Time& stamp, const std::string& map_frame);
DriveFeedback toFeedback(const NavigatorOutput& output, double measured_speed);

/// What rviz shows of the navigation.
struct NavigationView
{
  std::string map_frame;
  std::string base_link_frame;
  std::vector<Pose2> way;                     ///< in base_link
  std::optional<Eigen::Vector2d> look_ahead;  ///< in the map
  pi_detect::ObstacleArrayConstPtr obstacles;
  NavigatorOutput output;
};

/// The markers expire by themselves.
visualization_msgs::MarkerArray toMarkers(const NavigationView& view);

/// A frame's name without the leading slash that old nodes write.
std::string withoutSlash(const std::string& frame);

}  // namespace pi_vehicle
