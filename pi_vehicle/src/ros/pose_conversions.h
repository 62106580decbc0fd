#pragma once

#include <geometry_msgs/Pose.h>
#include <pi_vehicle/decision/pose2.h>

#include <cmath>

namespace pi_vehicle
{

/// On the ground: z = 0, turned about z only.
inline geometry_msgs::Pose toPose(const Pose2& pose)
{
  geometry_msgs::Pose message;
  message.position.x = pose.x;
  message.position.y = pose.y;
  message.orientation.z = std::sin(0.5 * pose.heading);
  message.orientation.w = std::cos(0.5 * pose.heading);
  return message;
}

}  // namespace pi_vehicle
