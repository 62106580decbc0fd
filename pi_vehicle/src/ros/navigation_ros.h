#pragma once

#include <actionlib/server/action_server.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_vehicle/DriveAction.h>
#include <pi_vehicle/LocalisationState.h>
#include <pi_vehicle/VehicleState.h>
#include "decision/navigator.h"
#include "ros/kept_parameters.h"
#include "ros/navigation_ros_options.h"
#include <pi_detect/ObstacleArray.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <string>

namespace pi_vehicle
{

/// Navigation on the graph: Navigator with topics around it.
///
/// Subscribes `odometry` (pose), `map_pose` (how well it is known in the map, where somebody says so), `localisation`
/// (LocalisationState, where there is a pose keeper), tf map -> odom, `vehicle_state` (speed, curvature, mode),
/// `obstacles`. Goals come by the action `drive` (Drive.action) or on the
/// topic `goal` (geometry_msgs/PoseStamped in any frame that tf knows); the latest counts. Service `~cancel`
/// (std_srvs/Trigger) ends either. The goal is kept on the parameter server: a navigation that died drives on to it.
/// Publishes `motion/navigation` (MotionCommand) at rate_hz, also without a goal; `route` (nav_msgs/Path, latched,
/// without poses when there is none); `~markers` while somebody listens; diagnostics.
///
/// All on one thread, `navigation`; nothing there waits. Times are those of ros::Time, the rate is that of a steady
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
  using ActionServer = actionlib::ActionServer<DriveAction>;
  using GoalHandle = ActionServer::GoalHandle;

  // inputs
  void onObstacles(const pi_detect::ObstacleArrayConstPtr& message);
  void onVehicleState(const VehicleStateConstPtr& message);
  /// Maps coordinates of a frame into the map, by the newest tf. @return nullopt, with the problem set, if unknown.
  std::optional<Eigen::Isometry3d> mapFrom(const std::string& frame, bool may_be_old, std::string* problem) const;
  NavigatorInput input(const ros::Time& now) const;

  // goals
  void onDrive(GoalHandle handle);
  void onCancel(GoalHandle handle);
  void onGoal(const geometry_msgs::PoseStampedConstPtr& message);
  bool onCancelService(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  /// @return why it cannot be, and the way out; empty: done.
  std::string addPlace(const std::string& name, NavigationGoal* goal) const;
  std::string addPose(const geometry_msgs::PoseStamped& pose, NavigationGoal* goal) const;
  std::string begin(const NavigationGoal& goal, const std::string& whose);
  /// Goes on with the goal of an earlier life, if there was one a short time ago. A client of the action notices
  /// nothing but a pause.
  void resumeGoal();
  void keepGoal(const ros::Time& now);
  /// Tells the client of the action, if it was one, how its goal ended.
  void endAction(DriveEnd end, const std::string& message);
  DriveResult result(bool success, const std::string& message) const;

  // outputs
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
  tf2_ros::Buffer tf_buffer_;
  Navigator navigator_;

  // newest inputs
  nav_msgs::OdometryConstPtr odometry_;
  geometry_msgs::PoseWithCovarianceStampedConstPtr map_pose_;  ///< none: nobody knows better than odometry
  VehicleStateConstPtr vehicle_;
  ros::Time vehicle_came_;
  pi_detect::ObstacleArrayConstPtr obstacles_;
  LocalisationStateConstPtr localisation_;  ///< of the pose keeper; none: there is no keeper

  KeptParameters kept_;
  ros::SteadyTime kept_at_;
  size_t kept_passed_ = 0;
  std::optional<GoalHandle> action_;  ///< of the goal that is driven to; none: it came on the topic
  std::string last_end_;              ///< of the goal before, for diagnostics
  NavigatorOutput output_;
  NavigatorState logged_state_ = NavigatorState::IDLE;
  unsigned slow_count_ = 0;

  tf2_ros::TransformListener tf_listener_;
  ros::Publisher motion_;
  ros::Publisher route_;
  ros::Publisher markers_;
  ros::Subscriber odometry_subscriber_;
  ros::Subscriber map_pose_subscriber_;
  ros::Subscriber obstacle_subscriber_;
  ros::Subscriber vehicle_subscriber_;
  ros::Subscriber localisation_subscriber_;
  ros::Subscriber goal_subscriber_;
  ros::ServiceServer cancel_;
  std::unique_ptr<ActionServer> server_;
  ros::SteadyTimer timer_;
  ros::WallTimer diagnostic_timer_;
};

}  // namespace pi_vehicle
