#include "ros/navigation/drive_goals.h"

#include <pi_node/durations.h>
#include <pi_node/vehicle_clock.h>

#include "ros/navigation/kept_goal.h"
#include "ros/navigation/navigation_conversions.h"
#include "ros/pose_conversions.h"

namespace pi_vehicle
{
namespace
{

constexpr size_t MAX_POINTS = 100;  // of a goal: planning is done between two commands
constexpr double KEEP_PERIOD_S = 1.0;

/// As its client sent it, but with points that are still ahead, in the map.
DriveActionGoalPtr toActionGoal(const KeptGoal& kept, const std::string& map_frame)
{
  const auto message = boost::make_shared<DriveActionGoal>();
  message->header.stamp = kept.stamp;
  message->goal_id.id = kept.id;
  message->goal_id.stamp = kept.stamp;
  message->goal.max_speed = kept.goal.max_speed;
  message->goal.loop = static_cast<uint8_t>(kept.goal.loop);
  for (const Waypoint& point : kept.goal.waypoints)
  {
    message->goal.waypoints.push_back(toMsg(point, map_frame));
  }
  return message;
}

}  // namespace

DriveGoals::DriveGoals(ros::NodeHandle node, ros::NodeHandle private_node, const NavigationRosOptions& options,
                       const NavigationInputs& inputs, Navigator* navigator, pi_node::WarningBoard* warnings)
  : node_(node)
  , private_node_(private_node)
  , options_(options)
  , inputs_(inputs)
  , navigator_(navigator)
  , warnings_(warnings)
  , kept_(private_node)
{
}

void DriveGoals::start()
{
  const auto subscribe = [this](const std::string& topic)
  {
    return node_.subscribe<geometry_msgs::PoseStamped>(
        topic, 2, [this, topic](const geometry_msgs::PoseStampedConstPtr& pose) { onGoal(*pose, topic); });
  };
  goal_subscriber_ = subscribe("goal");
  simple_goal_subscriber_ = subscribe("move_base_simple/goal");
  cancel_ = private_node_.advertiseService("cancel", &DriveGoals::onCancelService, this);
  server_ = std::make_unique<ActionServer>(
      node_, "drive", [this](GoalHandle handle) { onDrive(handle); },
      [this](const GoalHandle& handle)
      {
        if (action_ && *action_ == handle)
        {
          onCancel();
        }
      },
      false);
  move_base_server_ = std::make_unique<MoveBaseServer>(
      node_, "move_base", [this](MoveBaseHandle handle) { onMoveBase(handle); },
      [this](const MoveBaseHandle& handle)
      {
        if (move_base_ && *move_base_ == handle)
        {
          onCancel();
        }
      },
      false);
  server_->start();
  move_base_server_->start();
  resumeGoal();
}

std::string DriveGoals::addPlace(const std::string& name, NavigationGoal* goal) const
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

std::string DriveGoals::addPose(const geometry_msgs::PoseStamped& pose, NavigationGoal* goal) const
{
  std::string problem;
  const std::string& frame = pose.header.frame_id;
  const auto T_map_frame = inputs_.mapFrom(frame.empty() ? options_.map_frame : frame, true, &problem);
  if (T_map_frame)
  {
    goal->waypoints.push_back(toWaypoint(pose.pose, *T_map_frame));
  }
  return problem;
}

std::string DriveGoals::begin(const NavigationGoal& goal, const std::string& whose)
{
  const std::string problem = navigator_->start(goal, inputs_.at(ros::Time::now()));
  if (problem.empty())
  {
    endAction(DriveEnd::CANCELLED, "replaced by a later goal " + whose);
    kept_at_ns_.reset();  // to be kept at the next update
    ROS_INFO_STREAM_NAMED("navigation", "drives to a goal " << whose);
  }
  return problem;
}

void DriveGoals::resumeGoal()
{
  XmlRpc::XmlRpcValue value = std::string();
  kept_.find(KEPT_GOAL, "a goal", &value);
  const std::optional<KeptGoal> kept = toKeptGoal(value, private_node_.resolveName(KEPT_GOAL));
  if (!kept)
  {
    return;
  }
  const double age_s = ros::Time::now().toSec() - kept->alive;
  if (!(std::abs(age_s) <= options_.resume_goal_within_s))
  {
    ROS_INFO_STREAM_NAMED("navigation", "the goal of an earlier life, of " << age_s << " s ago, is forgotten");
    kept_.keep(KEPT_GOAL, std::string());
    return;
  }
  ROS_WARN_STREAM_NAMED("navigation", "was gone for up to " << age_s << " s; goes on to the goal that it had");
  if (!kept->id.empty())
  {
    server_->goalCallback(toActionGoal(*kept, options_.map_frame));
  }
  else
  {
    NavigationGoal goal = kept->goal;
    goal.find_way = true;
    if (const std::string problem = begin(goal, "of an earlier life"); !problem.empty())
    {
      warnings_->warn("the goal of an earlier life cannot be driven to: " + problem);
    }
  }
}

void DriveGoals::keepGoal(const ros::Time& now)
{
  const int64_t vehicle_ns = pi_node::vehicleNs();
  if (navigator_->passed() == kept_passed_ && kept_at_ns_ &&
      pi_node::secondsBetween(*kept_at_ns_, vehicle_ns) < KEEP_PERIOD_S)
  {
    return;
  }
  kept_at_ns_ = vehicle_ns;
  kept_passed_ = navigator_->passed();
  KeptGoal kept;
  kept.goal = navigator_->goal();
  kept.goal.waypoints.erase(kept.goal.waypoints.begin(),
                            kept.goal.waypoints.begin() + static_cast<ptrdiff_t>(kept_passed_));
  if (action_)
  {
    const actionlib_msgs::GoalID id = action_->getGoalID();
    kept.id = id.id;
    kept.stamp = id.stamp;
  }
  kept.alive = now.toSec();
  kept_.keep(KEPT_GOAL, toParameter(kept));
}

std::string DriveGoals::addPoints(const DriveGoal& wish, NavigationGoal* goal) const
{
  const size_t count = wish.places.size() + wish.waypoints.size();
  if (count > MAX_POINTS)
  {
    return "the goal has " + std::to_string(count) + " points, must have at most " + std::to_string(MAX_POINTS);
  }
  std::string problem;
  for (size_t i = 0; i < wish.places.size() && problem.empty(); ++i)
  {
    problem = addPlace(wish.places[i], goal);
  }
  for (size_t i = 0; i < wish.waypoints.size() && problem.empty(); ++i)
  {
    problem = addPose(wish.waypoints[i], goal);
  }
  return problem;
}

void DriveGoals::refuse(const std::string& problem)
{
  last_end_ = "refused: " + problem;
  warnings_->warn("goal refused: " + problem);
}

void DriveGoals::onDrive(GoalHandle handle)
{
  const DriveGoalConstPtr wish = handle.getGoal();
  NavigationGoal goal;
  goal.max_speed = wish->max_speed;
  goal.loop = wish->loop != 0;
  std::string problem = addPoints(*wish, &goal);
  if (problem.empty())
  {
    problem = begin(goal, "of the action " + node_.resolveName("drive"));
  }
  if (!problem.empty())
  {
    refuse(problem);
    DriveResult result;
    result.message = problem;
    handle.setRejected(result, problem);
    return;
  }
  handle.setAccepted();
  action_ = handle;
}

void DriveGoals::onMoveBase(MoveBaseHandle handle)
{
  NavigationGoal goal;
  goal.find_way = true;
  std::string problem = addPose(handle.getGoal()->target_pose, &goal);
  if (problem.empty())
  {
    problem = begin(goal, "of the action " + node_.resolveName("move_base"));
  }
  if (!problem.empty())
  {
    refuse(problem);
    handle.setRejected(move_base_msgs::MoveBaseResult(), problem);
    return;
  }
  handle.setAccepted();
  move_base_ = handle;
}

void DriveGoals::onGoal(const geometry_msgs::PoseStamped& pose, const std::string& topic)
{
  NavigationGoal goal;
  goal.find_way = true;
  std::string problem = addPose(pose, &goal);
  if (problem.empty())
  {
    problem = begin(goal, "on " + node_.resolveName(topic));
  }
  if (!problem.empty())
  {
    refuse(problem);
  }
}

void DriveGoals::onCancel()
{
  navigator_->cancel("cancelled by the client of the action");
}

bool DriveGoals::onCancelService(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  response.success = static_cast<uint8_t>(navigator_->active());
  response.message = navigator_->active() ? "slows down to a standstill" : "there is no goal";
  navigator_->cancel("cancelled by a call of " + cancel_.getService());
  return true;
}

void DriveGoals::onUpdate(const NavigatorOutput& output, const ros::Time& now)
{
  distance_ = output.distance;
  duration_s_ = output.duration_s;
  if (output.end != DriveEnd::NONE)
  {
    endAction(output.end, output.command.reason);
    last_end_ = output.command.reason;
    kept_.keep(KEPT_GOAL, std::string());
  }
  else if (navigator_->active())
  {
    keepGoal(now);
  }
}

void DriveGoals::publishFeedback(const NavigatorOutput& output)
{
  if (action_)
  {
    action_->publishFeedback(toFeedback(output, inputs_.vehicleSpeed()));
  }
  if (!move_base_)
  {
    return;
  }
  if (const std::optional<Pose2> pose = inputs_.at(ros::Time::now()).pose)
  {
    move_base_msgs::MoveBaseFeedback feedback;
    feedback.base_position.header.stamp = ros::Time::now();
    feedback.base_position.header.frame_id = options_.map_frame;
    feedback.base_position.pose = toPose(*pose);
    move_base_->publishFeedback(feedback);
  }
}

void DriveGoals::abort(const std::string& message)
{
  kept_.keep(KEPT_GOAL, std::string());
  endAction(DriveEnd::FAILED, message);
}

void DriveGoals::endAction(DriveEnd end, const std::string& message)
{
  const auto tell = [end, &message](auto* handle, const auto& result)
  {
    switch (end)
    {
      case DriveEnd::ARRIVED:
        handle->setSucceeded(result, message);
        break;
      case DriveEnd::CANCELLED:
        handle->setCanceled(result, message);
        break;
      default:
        handle->setAborted(result, message);
        break;
    }
  };
  if (action_)
  {
    DriveResult ended;
    ended.success = static_cast<uint8_t>(end == DriveEnd::ARRIVED);
    ended.message = message;
    ended.distance = distance_;
    ended.duration = ros::Duration(duration_s_);
    tell(&*action_, ended);
    action_.reset();
  }
  if (move_base_)
  {
    tell(&*move_base_, move_base_msgs::MoveBaseResult());
    move_base_.reset();
  }
}

}  // namespace pi_vehicle
