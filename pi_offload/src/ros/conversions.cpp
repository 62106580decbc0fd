#include "ros/conversions.h"

#include <pi_detect/ros/conversions.h>
#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace pi_offload
{
namespace
{

constexpr double LEAST_SPEED = 0.05;  ///< below this the heading is that of the pose [m/s]

}  // namespace

NodeDescription fromMsg(const EdgeNode& message)
{
  NodeDescription node;
  node.id = message.id;
  node.address = message.address;
  node.position = {message.x, message.y};
  node.range_m = message.range;
  node.network = message.network;
  if (message.frequency_ghz != 0.0)
  {
    node.frequency_ghz = message.frequency_ghz;
  }
  if (node.address.empty())
  {
    throw std::invalid_argument("node \"" + node.id + "\": address = \"\", must be host:port");
  }
  node.validate();
  return node;
}

EdgeNode toMsg(const NodeDescription& node, const std::string& frame)
{
  EdgeNode message;
  message.id = node.id;
  message.address = node.address;
  message.frame_id = frame;
  message.x = node.position.x;
  message.y = node.position.y;
  message.range = node.range_m;
  message.frequency_ghz = node.frequency_ghz;
  message.network = node.network;
  return message;
}

EdgeNodeStatus toMsg(const OffloadEngine::NodeStatus& status, const AnswerCheck::Status& check, uint64_t unasked,
                     const std::string& frame)
{
  EdgeNodeStatus message;
  message.node = toMsg(status.description, frame);
  message.connected = static_cast<uint8_t>(status.connected);
  message.in_range = static_cast<uint8_t>(status.in_range);
  message.distance = status.distance_m;
  message.residence = status.residence.now_s;
  message.round_trip = status.round_trip_s;
  message.uplink = status.uplink_mbps;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    message.kinds.emplace_back(toString(static_cast<TaskKind>(kind)));
    message.service_time.push_back(status.service_s[kind]);
    message.queue_time.push_back(status.queue_s[kind]);
  }
  message.sent = status.sent;
  message.answered = status.answered;
  message.late = status.late;
  message.refused = status.refused;
  message.lost = status.lost;
  message.unasked = unasked;
  message.checked = check.checked;
  message.disagreed = check.disagreed;
  message.distrusted = check.reason;
  return message;
}

std::map<std::string, int> idsByName(const pi_detect::LabelArray& labels)
{
  std::map<std::string, int> ids;
  for (size_t i = 0; i < std::min(labels.ids.size(), labels.names.size()); ++i)
  {
    ids.emplace(labels.names[i], static_cast<int>(labels.ids[i]));
  }
  return ids;
}

pi_detect::Detection2DArrayPtr toMsg(const std::vector<DetectedObject>& objects, const std::map<std::string, int>& ids,
                                     uint32_t width, uint32_t height, const std_msgs::Header& header)
{
  const auto right = static_cast<float>(width);
  const auto bottom = static_cast<float>(height);
  pi_detect::Detections detections;
  detections.reserve(objects.size());
  for (const DetectedObject& object : objects)
  {
    const auto id = ids.find(object.label);
    if (id != ids.end())
    {
      const pi_detect::Box box{std::clamp(object.x1, 0.0F, right), std::clamp(object.y1, 0.0F, bottom),
                               std::clamp(object.x2, 0.0F, right), std::clamp(object.y2, 0.0F, bottom)};
      detections.push_back({id->second, object.score, box});
    }
  }
  std::stable_sort(detections.begin(), detections.end(),
                   [](const pi_detect::Detection& a, const pi_detect::Detection& b) { return a.score > b.score; });
  return pi_detect::toMsg(detections, header);
}

const char* toString(Outcome::How how)
{
  switch (how)
  {
    case Outcome::How::LOCAL:
      return "local";
    case Outcome::How::REMOTE:
      return "remote";
    case Outcome::How::FALLBACK:
      return "fallback";
    case Outcome::How::ABANDONED:
      return "abandoned";
  }
  return "unknown";
}

OffloadDecision toMsg(const Outcome& outcome, const std_msgs::Header& header, bool dropped)
{
  OffloadDecision message;
  message.header = header;
  message.kind = toString(outcome.task.kind);
  message.node = outcome.node;
  message.how = toString(outcome.how);
  message.reason = outcome.reason;
  message.deadline = outcome.task.deadline_s;
  message.expected_time = outcome.expected_s;
  message.expected_energy = outcome.expected_j;
  message.expected_misses = outcome.expected_misses;
  message.hedged = static_cast<uint8_t>(outcome.hedged);
  message.response_time = pi_node::secondsBetween(outcome.task.created_ns, outcome.finished_ns);
  message.by_deadline = static_cast<uint8_t>(outcome.by_deadline);
  message.dropped = static_cast<uint8_t>(dropped);
  message.energy = outcome.energy_j;
  return message;
}

OffloadStatistics toMsg(TaskKind kind, const OffloadEngine::Statistics::OfKind& statistics, double p50_s, double p99_s)
{
  OffloadStatistics message;
  message.kind = toString(kind);
  message.tasks = statistics.tasks;
  message.local = statistics.local;
  message.remote = statistics.remote;
  message.fallback = statistics.fallback;
  message.abandoned = statistics.abandoned;
  message.missed = statistics.missed;
  message.handovers = statistics.handovers;
  message.energy = statistics.energy_j;
  message.response_time_p50 = p50_s;
  message.response_time_p99 = p99_s;
  return message;
}

VehicleState fromMsg(const nav_msgs::Odometry& message, const Eigen::Isometry3d& T_map_odom)
{
  const auto& pose = message.pose.pose;
  const auto& twist = message.twist.twist.linear;
  const Eigen::Quaterniond rotation(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z);
  const double norm = rotation.norm();
  VehicleState state;
  if (!(norm > 1e-6 && std::isfinite(norm)))
  {
    return state;
  }
  const Eigen::Vector3d p_map = T_map_odom * Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  const Eigen::Matrix3d R_map_base = T_map_odom.linear() * rotation.normalized().toRotationMatrix();
  const Eigen::Vector3d velocity = R_map_base * Eigen::Vector3d(twist.x, twist.y, twist.z);
  const Eigen::Vector3d forward = R_map_base.col(0);
  state.position = {p_map.x(), p_map.y()};
  state.speed = velocity.head<2>().norm();
  const Eigen::Vector3d& along = state.speed >= LEAST_SPEED ? velocity : forward;
  state.heading = headingOfYaw(std::atan2(along.y(), along.x()));
  state.known = std::isfinite(state.position.x) && std::isfinite(state.position.y) && std::isfinite(state.speed) &&
                std::isfinite(state.heading);
  return state;
}

std::vector<Point> fromMsg(const nav_msgs::Path& message, const Eigen::Isometry3d& T_map_path)
{
  std::vector<Point> route;
  route.reserve(message.poses.size());
  for (size_t i = 0; i < message.poses.size(); ++i)
  {
    const auto& position = message.poses[i].pose.position;
    const Eigen::Vector3d p_map = T_map_path * Eigen::Vector3d(position.x, position.y, position.z);
    if (!p_map.allFinite())
    {
      throw std::invalid_argument("pose " + std::to_string(i + 1) + " of the route is not finite");
    }
    route.push_back({p_map.x(), p_map.y()});
  }
  return route;
}

std::optional<double> chargeOf(const sensor_msgs::BatteryState& message)
{
  double charge = message.percentage;
  if (!std::isfinite(charge) || charge < 0.0)
  {
    const double capacity = message.capacity > 0.0F ? message.capacity : message.design_capacity;
    charge = static_cast<double>(message.charge) / capacity;
  }
  if (!std::isfinite(charge) || charge < 0.0)
  {
    return std::nullopt;
  }
  return std::min(charge, 1.0);
}

}  // namespace pi_offload
