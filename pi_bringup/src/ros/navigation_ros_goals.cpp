// How goals come to NavigationRos, and how their clients learn what became of them.

#include <pi_bringup/ros/navigation_conversions.h>
#include <pi_bringup/ros/navigation_ros.h>

namespace pi_bringup
{
namespace
{

constexpr size_t MAX_POINTS = 100;  // of a goal: planning is done between two commands

}  // namespace

std::string NavigationRos::addPlace(const std::string& name, NavigationGoal* goal) const
{
  const auto place = options_.places.find(name);
  if (place == options_.places.end())
  {
    std::string known;
    for (const auto& [one, point] : options_.places)
    {
      known += (known.empty() ? "" : ", ") + one;
    }
    return "there is no place \"" + name + "\"; known are " +
           (known.empty() ? "none: set " + private_node_.resolveName("places") : known);
  }
  goal->waypoints.push_back(place->second);
  return "";
}

std::string NavigationRos::addPose(const geometry_msgs::PoseStamped& pose, NavigationGoal* goal) const
{
  std::string problem;
  const std::string& frame = pose.header.frame_id;
  const auto T_map_frame = mapFrom(frame.empty() ? options_.map_frame : frame, true, &problem);
  if (T_map_frame)
  {
    goal->waypoints.push_back(toWaypoint(pose.pose, *T_map_frame));
  }
  return problem;
}

std::string NavigationRos::begin(const NavigationGoal& goal, const std::string& whose)
{
  const std::string problem = navigator_.start(goal, input(ros::Time::now()));
  if (problem.empty())
  {
    endAction(DriveEnd::CANCELLED, "replaced by a later goal " + whose);
    ROS_INFO_STREAM_NAMED("navigation", "drives to a goal " << whose);
  }
  return problem;
}

void NavigationRos::onDrive(GoalHandle handle)
{
  const DriveGoalConstPtr wish = handle.getGoal();
  NavigationGoal goal;
  goal.max_speed = wish->max_speed;
  goal.loop = wish->loop != 0;
  std::string problem;
  if (wish->places.size() + wish->waypoints.size() > MAX_POINTS)
  {
    problem = "the goal has " + std::to_string(wish->places.size() + wish->waypoints.size()) +
              " points, must have at most " + std::to_string(MAX_POINTS);
  }
  for (size_t i = 0; i < wish->places.size() && problem.empty(); ++i)
  {
    problem = addPlace(wish->places[i], &goal);
  }
  for (size_t i = 0; i < wish->waypoints.size() && problem.empty(); ++i)
  {
    problem = addPose(wish->waypoints[i], &goal);
  }
  if (problem.empty())
  {
    problem = begin(goal, "of the action " + service_node_.resolveName("drive"));
  }
  if (!problem.empty())
  {
    last_end_ = "refused: " + problem;
    warnings_.warn("goal refused: " + problem);
    handle.setRejected(DriveResult(result(false, problem)), problem);
    return;
  }
  handle.setAccepted();
  action_ = handle;
}

void NavigationRos::onGoal(const geometry_msgs::PoseStampedConstPtr& message)
{
  NavigationGoal goal;
  std::string problem = addPose(*message, &goal);
  if (problem.empty())
  {
    problem = begin(goal, "on " + goal_subscriber_.getTopic());
  }
  if (!problem.empty())
  {
    last_end_ = "refused: " + problem;
    warnings_.warn("goal refused: " + problem);
  }
}

void NavigationRos::onCancel(GoalHandle handle)
{
  if (action_ && *action_ == handle)
  {
    navigator_.cancel("cancelled by the client of the action");
  }
}

bool NavigationRos::onCancelService(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  response.success = static_cast<uint8_t>(navigator_.active());
  response.message = navigator_.active() ? "slows down to a standstill" : "there is no goal";
  navigator_.cancel("cancelled by a call of " + cancel_.getService());
  return true;
}

DriveResult NavigationRos::result(bool success, const std::string& message) const
{
  DriveResult result;
  result.success = static_cast<uint8_t>(success);
  result.message = message;
  return result;
}

void NavigationRos::endAction(DriveEnd end, const std::string& message)
{
  if (!action_)
  {
    return;
  }
  DriveResult ended = result(end == DriveEnd::ARRIVED, message);
  ended.distance = output_.distance;
  ended.duration = ros::Duration(output_.duration_s);
  switch (end)
  {
    case DriveEnd::ARRIVED:
      action_->setSucceeded(ended, message);
      break;
    case DriveEnd::CANCELLED:
      action_->setCanceled(ended, message);
      break;
    default:
      action_->setAborted(ended, message);
      break;
  }
  action_.reset();
}

}  // namespace pi_bringup
