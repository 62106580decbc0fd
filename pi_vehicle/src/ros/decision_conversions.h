#pragma once

#include "decision/arbiter.h"
#include "decision/reaction_rules.h"

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/Twist.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_vehicle/ArbiterState.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/ReactionEvent.h>
#include <pi_vehicle/decision/pose2.h>
#include <ros/time.h>

#include <cstdint>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// What a source that only bounds the speed says where it has no bound [m/s]; numbers in messages must be finite.
constexpr double NO_SPEED_LIMIT = 1000.0;

inline int64_t toNs(const ros::Time& time)
{
  return static_cast<int64_t>(time.toNSec());
}

/// Fields as they are, with the source that the topic names.
DriveCommand toDriveCommand(const MotionCommand& message, const std::string& source);
/// linear.x and angular.z; slower than 0.01 m/s the curvature is 0, as a car cannot turn on the spot.
DriveCommand toDriveCommand(const geometry_msgs::Twist& message, const std::string& source);
MotionCommand toMotionCommand(const DriveCommand& command, const ros::Time& stamp);

/// Obstacles seen within max_unseen_s, by the middles of their outlines, or of their boxes where they have none. What
/// has no class has score 1: it is there.
std::vector<SeenThing> toSeenThings(const pi_detect::ObstacleArray& message, double max_unseen_s);
/// @param said  the text that was said, if any.
ReactionEvent toMsg(const RuleEvent& event, const std_msgs::Header& header, const std::string& said);

/// When the command was spoken: the end of the speech, or `now` for a message without stamps.
int64_t spokenNs(const pi_speech::VoiceCommand& message, const ros::Time& now);
geometry_msgs::PoseStamped toGoal(const Pose2& place, const ros::Time& stamp, const std::string& map_frame);

ArbiterState toArbiterState(const Arbiter& arbiter, const ArbiterOutput& output, const ros::Time& stamp);
/// The same but for stamps, ages, speeds, and numbers in the reason.
bool sameState(const ArbiterState& a, const ArbiterState& b);

}  // namespace pi_vehicle
