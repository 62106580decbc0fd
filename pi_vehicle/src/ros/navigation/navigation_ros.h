#pragma once

#include "decision/navigator.h"
#include "ros/navigation/drive_goals.h"
#include "ros/navigation/navigation_inputs.h"
#include "ros/navigation/navigation_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <nav_msgs/OccupancyGrid.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

namespace pi_vehicle
{

/// Runs the Navigator on the graph: NavigationInputs before it, DriveGoals beside it.
///
/// Subscribes `odometry` (pose), `map_pose` (its deviation in the map, optional), `localisation` (LocalisationState of
/// the pose keeper, optional), tf map -> odom, `vehicle_state` (speed, curvature, mode), `obstacles`, `grid` (the
/// ground around the vehicle, for ways round obstacles) and `map` (that of the whole map, for goals). Goals come by the
/// action `drive` (Drive.action) or on the topic `goal` (geometry_msgs/PoseStamped in any frame that tf knows); the
/// latest counts. The service `~cancel` (std_srvs/Trigger) ends either. The goal is kept on the parameter server: a
/// navigation that restarts drives on to it.
/// Publishes `motion/navigation` (MotionCommand) at rate_hz, also without a goal; `route` (nav_msgs/Path, latched,
/// without poses when there is none); `~markers` while they have a subscriber; diagnostics.
///
/// All callbacks run on one thread, `navigation`, and none waits. Stamps are ros::Time; the rate follows a steady
/// clock.
class NavigationRos
{
public:
  /// Advertises, and begins. @throws std::invalid_argument for wrong parameters.
  NavigationRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// A goal that is being driven to is aborted. Its client may not hear of it: roscpp can lose what a publisher sends
  /// last.
  ~NavigationRos();
  NavigationRos(const NavigationRos&) = delete;
  NavigationRos& operator=(const NavigationRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void onObstacles(const pi_detect::ObstacleArrayConstPtr& message);
  void onGrid(const nav_msgs::OccupancyGridConstPtr& message, bool whole_map);
  void update();
  void publishRoute(const ros::Time& now);
  void publishSlowly();
  void logState();
  void report(Status& status) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  ros::NodeHandle private_node_;
  const NavigationRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  Navigator navigator_;
  NavigationInputs inputs_;
  DriveGoals goals_;
  pi_detect::ObstacleArrayConstPtr obstacles_;
  NavigatorOutput output_;
  NavigatorState logged_state_ = NavigatorState::IDLE;
  unsigned slow_count_ = 0;

  ros::Publisher motion_;
  ros::Publisher route_;
  ros::Publisher markers_;
  ros::Subscriber obstacle_subscriber_;
  ros::Subscriber grid_subscriber_;
  ros::Subscriber map_subscriber_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer diagnostic_timer_;
};

}  // namespace pi_vehicle
