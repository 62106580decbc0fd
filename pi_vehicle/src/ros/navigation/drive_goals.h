#pragma once

#include "decision/navigator.h"
#include "ros/kept_parameters.h"
#include "ros/navigation/navigation_inputs.h"
#include "ros/navigation/navigation_ros_options.h"

#include <actionlib/server/action_server.h>
#include <geometry_msgs/PoseStamped.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/DriveAction.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <memory>
#include <optional>
#include <string>

namespace pi_vehicle
{

/// Brings goals to the Navigator: from the actions `drive` and `move_base`, the topics `goal` and
/// `move_base_simple/goal` and the parameter server, and tells their clients how they ended. The latest goal counts;
/// the service `~cancel` ends it. Not thread safe, like NavigationInputs.
class DriveGoals
{
public:
  DriveGoals(ros::NodeHandle node, ros::NodeHandle private_node, const NavigationRosOptions& options,
             const NavigationInputs& inputs, Navigator* navigator, pi_node::WarningBoard* warnings);

  /// Begins to take goals, first of all the one that was driven to when this node died a short time ago. A client of
  /// the action notices only a pause.
  void start();
  /// To be called after each update of the navigator: tells the end of a goal, or keeps the goal on the parameter
  /// server.
  void onUpdate(const NavigatorOutput& output, const ros::Time& now);
  void publishFeedback(const NavigatorOutput& output);
  /// The goal is aborted and no longer kept.
  void abort(const std::string& message);
  const std::string& lastEnd() const { return last_end_; }  ///< of the goal before; empty: none

private:
  using ActionServer = actionlib::ActionServer<DriveAction>;
  using GoalHandle = ActionServer::GoalHandle;

  using MoveBaseServer = actionlib::ActionServer<move_base_msgs::MoveBaseAction>;
  using MoveBaseHandle = MoveBaseServer::GoalHandle;

  void onDrive(GoalHandle handle);
  void onMoveBase(MoveBaseHandle handle);
  void onCancel();
  void onGoal(const geometry_msgs::PoseStamped& pose, const std::string& topic);
  bool onCancelService(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  /// @return why the place cannot be used, and the way out; empty: done.
  std::string addPlace(const std::string& name, NavigationGoal* goal) const;
  std::string addPose(const geometry_msgs::PoseStamped& pose, NavigationGoal* goal) const;
  std::string addPoints(const DriveGoal& wish, NavigationGoal* goal) const;
  std::string begin(const NavigationGoal& goal, const std::string& whose);
  void refuse(const std::string& problem);
  void resumeGoal();
  void keepGoal(const ros::Time& now);
  /// Does nothing if the goal came on a topic.
  void endAction(DriveEnd end, const std::string& message);

  ros::NodeHandle node_;
  ros::NodeHandle private_node_;
  const NavigationRosOptions& options_;
  const NavigationInputs& inputs_;
  Navigator* navigator_;
  pi_node::WarningBoard* warnings_;
  KeptParameters kept_;
  std::optional<int64_t> kept_at_ns_;
  size_t kept_passed_ = 0;
  // Of the goal that is driven to; none: it came on a topic.
  std::optional<GoalHandle> action_;
  std::optional<MoveBaseHandle> move_base_;
  std::string last_end_;
  double distance_ = 0.0;    ///< driven to the goal [m]
  double duration_s_ = 0.0;  ///< likewise
  ros::Subscriber goal_subscriber_;
  ros::Subscriber simple_goal_subscriber_;
  ros::ServiceServer cancel_;
  std::unique_ptr<ActionServer> server_;
  std::unique_ptr<MoveBaseServer> move_base_server_;
};

}  // namespace pi_vehicle
