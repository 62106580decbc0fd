#include "ros/decision_conversions.h"

#include "ros/pose_conversions.h"

#include <algorithm>
#include <cctype>
#include <cmath>

namespace pi_vehicle
{
namespace
{

constexpr double STANDING = 0.01;  // [m/s]

std::string withoutNumbers(std::string text)
{
  const auto numeric = [](unsigned char character) { return std::isdigit(character) || character == '.'; };
  text.erase(std::remove_if(text.begin(), text.end(), numeric), text.end());
  return text;
}

}  // namespace

DriveCommand toDriveCommand(const MotionCommand& message, const std::string& source)
{
  return {message.speed, message.curvature, message.max_deceleration, source, message.reason};
}

DriveCommand toDriveCommand(const geometry_msgs::Twist& message, const std::string& source)
{
  DriveCommand command;
  command.speed = message.linear.x;
  // A yaw rate that is no number stays one, so that the command is refused.
  command.curvature = std::abs(command.speed) >= STANDING ? message.angular.z / command.speed : 0.0 * message.angular.z;
  command.source = source;
  command.reason = "remote/cmd_vel";
  return command;
}

MotionCommand toMotionCommand(const DriveCommand& command, const ros::Time& stamp)
{
  MotionCommand message;
  message.header.stamp = stamp;
  message.speed = command.speed;
  message.curvature = command.curvature;
  message.max_deceleration = command.max_deceleration;
  message.source = command.source;
  message.reason = command.reason;
  return message;
}

namespace
{

/// Of the area of its outline; of its box, where there is none.
Eigen::Vector2d middleOf(const pi_detect::Obstacle3D& obstacle)
{
  const auto& outline = obstacle.outline;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double area = 0.0;
  for (size_t i = 1; i + 1 < outline.size(); ++i)
  {
    // Triangles about the first corner.
    const Eigen::Vector2d a(outline[i].x - outline[0].x, outline[i].y - outline[0].y);
    const Eigen::Vector2d b(outline[i + 1].x - outline[0].x, outline[i + 1].y - outline[0].y);
    const double twice = a.x() * b.y() - a.y() * b.x();
    sum += twice / 3.0 * (a + b);
    area += twice;
  }
  if (!(area > 1e-6))
  {
    return {obstacle.position.x, obstacle.position.y};
  }
  return Eigen::Vector2d(outline[0].x, outline[0].y) + sum / area;
}

}  // namespace

std::vector<SeenThing> toSeenThings(const pi_detect::ObstacleArray& message, double max_unseen_s)
{
  std::vector<SeenThing> things;
  for (const pi_detect::Obstacle3D& obstacle : message.obstacles)
  {
    if (obstacle.since_seen.toSec() > max_unseen_s)
    {
      continue;
    }
    things.push_back({obstacle.id, obstacle.label, obstacle.label.empty() ? 1.0 : obstacle.score, middleOf(obstacle)});
  }
  return things;
}

ReactionEvent toMsg(const RuleEvent& event, const std_msgs::Header& header, const std::string& said)
{
  ReactionEvent message;
  message.header = header;
  message.rule = event.rule;
  message.action = toString(event.action);
  message.text = said;
  message.id = event.thing.id;
  message.label = event.thing.label;
  message.position.x = event.thing.position.x();
  message.position.y = event.thing.position.y();
  return message;
}

int64_t spokenNs(const pi_speech::VoiceCommand& message, const ros::Time& now)
{
  const ros::Time& end = message.speech_end.isZero() ? message.header.stamp : message.speech_end;
  return static_cast<int64_t>((end.isZero() ? now : end).toNSec());
}

geometry_msgs::PoseStamped toGoal(const Pose2& place, const ros::Time& stamp, const std::string& map_frame)
{
  geometry_msgs::PoseStamped goal;
  goal.header.stamp = stamp;
  goal.header.frame_id = map_frame;
  goal.pose = toPose(place);
  return goal;
}

ArbiterState toArbiterState(const Arbiter& arbiter, const ArbiterOutput& output, const ros::Time& stamp)
{
  ArbiterState state;
  state.header.stamp = stamp;
  state.driver = output.driver;
  state.limited_by = output.limited_by;
  state.reason = output.command.reason;
  state.emergency = output.emergency_stop;
  for (size_t i = 0; i < arbiter.sources().size(); ++i)
  {
    const ArbiterSource& source = arbiter.options().sources[i];
    const ArbiterSourceState& known = arbiter.sources()[i];
    SourceState one;
    one.name = source.name;
    one.drives = source.drives;
    one.required = source.required;
    one.alive = known.alive;
    one.age = known.heard ? 1e-9 * static_cast<double>(static_cast<int64_t>(stamp.toNSec()) - known.stamp_ns) : -1.0;
    one.speed = known.command.speed;
    state.sources.push_back(one);
  }
  return state;
}

bool sameState(const ArbiterState& a, const ArbiterState& b)
{
  return a.driver == b.driver && a.limited_by == b.limited_by && a.emergency == b.emergency &&
         withoutNumbers(a.reason) == withoutNumbers(b.reason) &&
         std::equal(a.sources.begin(), a.sources.end(), b.sources.begin(), b.sources.end(),
                    [](const SourceState& one, const SourceState& other)
                    { return one.name == other.name && one.alive == other.alive; });
}

}  // namespace pi_vehicle
