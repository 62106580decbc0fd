#pragma once

#include "decision/navigator.h"

#include <ros/time.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <optional>
#include <string>

namespace pi_vehicle
{

/// The private parameter of a KeptGoal.
constexpr char KEPT_GOAL[] = "kept_goal";

/// The present goal, kept for a restart of the navigation.
struct KeptGoal
{
  NavigationGoal goal;  ///< points that are still ahead, in the map
  std::string id;       ///< of the action; empty: it came on the topic
  ros::Time stamp;      ///< of the action's goal
  double alive = 0.0;   ///< ros::Time at which this was written [s]
};

/// {points: [[x, y] or [x, y, heading], ...], max_speed, loop, id, stamp, alive}
XmlRpc::XmlRpcValue toParameter(const KeptGoal& kept);

/// @param name  for the message.
/// @return nullopt for "", the value after a goal ended. @throws std::invalid_argument for anything else.
std::optional<KeptGoal> toKeptGoal(const XmlRpc::XmlRpcValue& value, const std::string& name);

}  // namespace pi_vehicle
