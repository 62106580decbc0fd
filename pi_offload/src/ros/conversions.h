#pragma once

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_offload/EdgeNode.h>
#include <pi_offload/EdgeNodeStatus.h>
#include <pi_offload/OffloadDecision.h>
#include <pi_offload/OffloadStatistics.h>
#include "engine/offload_engine.h"
#include "wire/wire_message.h"
#include <sensor_msgs/BatteryState.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

namespace pi_offload
{

/// A node as it is announced. The position stays in the message's frame. A frequency of 0 is not known: the default.
/// @throws std::invalid_argument naming what is wrong, also for a node without an address.
NodeDescription fromMsg(const EdgeNode& message);
/// @param frame  of the position.
EdgeNode toMsg(const NodeDescription& node, const std::string& frame);
EdgeNodeStatus toMsg(const OffloadEngine::NodeStatus& status, const std::string& frame);

/// What a node found in a picture, best scores first as pi_detect has them. Boxes are cut off at the picture's border.
/// @param width, height  of the picture [px]. @param header  of the picture.
pi_detect::Detection2DArrayPtr toMsg(const std::vector<DetectedObject>& objects, uint32_t width, uint32_t height,
                                     const std_msgs::Header& header);
std::vector<DetectedObject> fromMsg(const pi_detect::Detection2DArray& message);

/// @param header  of the picture or utterance.
OffloadDecision toMsg(const Outcome& outcome, const std_msgs::Header& header);
OffloadStatistics toMsg(TaskKind kind, const OffloadEngine::Statistics::OfKind& statistics, double p50_s, double p99_s);
/// "local", "remote", "fallback" or "abandoned".
const char* toString(Outcome::How how);

/// Position, heading and speed over the ground. The heading is that of the motion, where there is one, so that it is
/// right for a vehicle that drives backwards.
/// @param T_map_odom  from the message's frame to the map. Not known, if a number is not finite.
VehicleState fromMsg(const nav_msgs::Odometry& message, const Eigen::Isometry3d& T_map_odom);
/// @param T_map_path  from the path's frame to the map. @throws std::invalid_argument for numbers that are not finite.
std::vector<Point> fromMsg(const nav_msgs::Path& message, const Eigen::Isometry3d& T_map_path);

/// Charge of the battery, 0 to 1: its percentage, or else charge by capacity. nullopt: it says neither.
std::optional<double> chargeOf(const sensor_msgs::BatteryState& message);

}  // namespace pi_offload
