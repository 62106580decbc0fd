#pragma once

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_offload/EdgeNode.h>
#include <pi_offload/EdgeNodeStatus.h>
#include <pi_offload/OffloadDecision.h>
#include <pi_offload/OffloadStatistics.h>
#include <sensor_msgs/BatteryState.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "engine/offload_engine.h"
#include "ros/answer_check.h"
#include "wire/wire_message.h"

namespace pi_offload
{

/// The position stays in the message's frame. A frequency of 0 means the default.
/// @throws std::invalid_argument naming what is wrong, also for a missing address.
NodeDescription fromMsg(const EdgeNode& message);
/// @param frame  of the position.
EdgeNode toMsg(const NodeDescription& node, const std::string& frame);
EdgeNodeStatus toMsg(const OffloadEngine::NodeStatus& status, const AnswerCheck::Status& check, uint64_t unasked,
                     const std::string& frame);

/// The numbers of a network's classes by their names.
std::map<std::string, int> idsByName(const pi_detect::LabelArray& labels);

/// Objects in a picture, best scores first. Boxes are cut at the border of the picture.
/// @param ids  of the classes of the vehicle's network, by name. Objects of other classes are left out.
/// @param width, height  of the picture [px]. @param header  of the picture.
pi_detect::Detection2DArrayPtr toMsg(const std::vector<DetectedObject>& objects, const std::map<std::string, int>& ids,
                                     uint32_t width, uint32_t height, const std_msgs::Header& header);

/// @param header  of the picture or utterance. @param dropped  no result was published.
OffloadDecision toMsg(const Outcome& outcome, const std_msgs::Header& header, bool dropped);
OffloadStatistics toMsg(TaskKind kind, const OffloadEngine::Statistics::OfKind& statistics, double p50_s, double p99_s);
/// "local", "remote", "fallback" or "abandoned".
const char* toString(Outcome::How how);

/// Position, heading and speed over the ground. The heading follows the motion, also backwards; a standing vehicle has
/// the heading of its pose. `known` is false if a number is not finite.
/// @param T_map_odom  from the message's frame to the map.
VehicleState fromMsg(const nav_msgs::Odometry& message, const Eigen::Isometry3d& T_map_odom);
/// @param T_map_path  from the path's frame to the map. @throws std::invalid_argument for numbers that are not finite.
std::vector<Point> fromMsg(const nav_msgs::Path& message, const Eigen::Isometry3d& T_map_path);

/// Charge of the battery, 0 to 1, from its percentage or from charge and capacity; nullopt if both are missing.
std::optional<double> chargeOf(const sensor_msgs::BatteryState& message);

}  // namespace pi_offload
