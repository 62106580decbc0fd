#include "ros/navigation/navigation_conversions.h"

#include "ros/decision_conversions.h"
#include "ros/pose_conversions.h"

#include <algorithm>
#include <cmath>

namespace pi_vehicle
{
namespace
{

using visualization_msgs::Marker;

constexpr double LIFETIME_S = 1.0;  // of markers
constexpr double NO_TURN = 1e-9;    // quaternions that are shorter have none

Eigen::Isometry3d toIsometry(double x, double y, double z, const geometry_msgs::Quaternion& rotation)
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() << x, y, z;
  const Eigen::Quaterniond q(rotation.w, rotation.x, rotation.y, rotation.z);
  if (!(q.norm() < NO_TURN))  // NaN goes on
  {
    pose.linear() = (Eigen::Quaterniond(q.coeffs() / q.norm())).toRotationMatrix();
  }
  return pose;
}

geometry_msgs::Point toPoint(double x, double y, double z)
{
  geometry_msgs::Point point;
  point.x = x;
  point.y = y;
  point.z = z;
  return point;
}

Marker makeMarker(const std::string& frame, const char* group, int32_t type, double scale,
                  const NavigatorOutput& output)
{
  Marker marker;
  marker.header.frame_id = frame;  // with stamp 0: the newest transform
  marker.ns = group;
  marker.type = type;
  marker.action = Marker::ADD;
  marker.pose.orientation.w = 1.0;
  marker.scale.x = marker.scale.y = marker.scale.z = scale;
  marker.lifetime = ros::Duration(LIFETIME_S);
  const bool drives = output.state == NavigatorState::DRIVING;
  const bool waits = output.state == NavigatorState::HELD_UP || output.state == NavigatorState::STOPPING ||
                     output.state == NavigatorState::WAITING;
  marker.color.r = drives ? 0.1F : 1.0F;
  marker.color.g = drives ? 0.8F : waits ? 0.6F : 0.1F;
  marker.color.b = 0.1F;
  marker.color.a = 0.8F;
  return marker;
}

Marker boxOf(const pi_detect::Obstacle3D& obstacle, const NavigationView& view)
{
  Marker box = makeMarker(view.base_link_frame, "obstacle", Marker::CUBE, 0.1, view.output);
  box.pose.position = obstacle.position;
  box.scale.x = std::max(0.1, obstacle.size.x);
  box.scale.y = std::max(0.1, obstacle.size.y);
  box.scale.z = std::max(0.1, obstacle.size.z);
  return box;
}

/// Of the outline as a prism: below, above, and at each corner.
Marker edgesOf(const pi_detect::Obstacle3D& obstacle, const NavigationView& view)
{
  Marker edges = makeMarker(view.base_link_frame, "obstacle", Marker::LINE_LIST, 0.05, view.output);
  for (size_t i = 0; i < obstacle.outline.size(); ++i)
  {
    const geometry_msgs::Point32& from = obstacle.outline[i];
    const geometry_msgs::Point32& to = obstacle.outline[(i + 1) % obstacle.outline.size()];
    for (const double height : {0.0, obstacle.size.z})
    {
      edges.points.push_back(toPoint(from.x, from.y, from.z + height));
      edges.points.push_back(toPoint(to.x, to.y, to.z + height));
    }
    edges.points.push_back(toPoint(from.x, from.y, from.z));
    edges.points.push_back(toPoint(from.x, from.y, from.z + obstacle.size.z));
  }
  return edges;
}

}  // namespace

Eigen::Isometry3d toIsometry(const geometry_msgs::Transform& transform)
{
  return toIsometry(transform.translation.x, transform.translation.y, transform.translation.z, transform.rotation);
}

Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose)
{
  return toIsometry(pose.position.x, pose.position.y, pose.position.z, pose.orientation);
}

Pose2 toPose2(const Eigen::Isometry3d& pose)
{
  return {pose.translation().x(), pose.translation().y(), std::atan2(pose.linear()(1, 0), pose.linear()(0, 0))};
}

Waypoint toWaypoint(const geometry_msgs::Pose& pose, const Eigen::Isometry3d& T_map_pose_frame)
{
  const Pose2 in_map = toPose2(T_map_pose_frame * toIsometry(pose));
  const geometry_msgs::Quaternion& q = pose.orientation;
  Waypoint waypoint;
  waypoint.position = in_map.position();
  if (!(std::hypot(std::hypot(q.x, q.y), std::hypot(q.z, q.w)) < NO_TURN))
  {
    waypoint.heading = in_map.heading;
  }
  return waypoint;
}

geometry_msgs::PoseStamped toMsg(const Waypoint& waypoint, const std::string& map_frame)
{
  geometry_msgs::PoseStamped message;
  message.header.frame_id = map_frame;
  message.pose = toPose(Pose2{waypoint.position.x(), waypoint.position.y(), waypoint.heading.value_or(0.0)});
  if (!waypoint.heading)
  {
    message.pose.orientation = geometry_msgs::Quaternion();  // of length 0: any heading will do
  }
  return message;
}

double positionDeviation(const geometry_msgs::PoseWithCovariance& pose)
{
  constexpr size_t ROW = 6;
  const auto& covariance = pose.covariance;
  const double xx = covariance[0];
  const double yy = covariance[ROW + 1];
  const double xy = 0.5 * (covariance[1] + covariance[ROW]);
  const double largest = 0.5 * (xx + yy) + std::hypot(0.5 * (xx - yy), xy);
  return largest <= 0.0 ? 0.0 : std::sqrt(largest);  // NaN stays NaN
}

std::string vehicleProblem(const VehicleState& state)
{
  const std::string detail = state.detail.empty() ? "" : ": " + state.detail;
  switch (state.mode)
  {
    case VehicleState::EMERGENCY_STOP:
      return "emergency stop" + detail;
    case VehicleState::FAULT:
      return "fault" + detail;
    case VehicleState::DISCONNECTED:
      return "disconnected" + detail;
    default:
      return "";
  }
}

std::vector<ObstacleBox> toObstacleBoxes(const pi_detect::ObstacleArray& obstacles)
{
  std::vector<ObstacleBox> boxes;
  boxes.reserve(obstacles.obstacles.size());
  for (const pi_detect::Obstacle3D& obstacle : obstacles.obstacles)
  {
    ObstacleBox box;
    box.id = obstacle.id;
    box.position = {obstacle.position.x, obstacle.position.y};
    box.size = {obstacle.size.x, obstacle.size.y};
    box.velocity = {obstacle.velocity.x, obstacle.velocity.y};
    box.top = obstacle.position.z + 0.5 * obstacle.size.z;
    box.label = obstacle.label;
    box.moving = obstacle.moving != 0;
    box.unseen_s = obstacle.since_seen.toSec();
    box.followed_s = obstacle.age.toSec() - box.unseen_s;
    for (const geometry_msgs::Point32& corner : obstacle.outline)
    {
      box.outline.emplace_back(corner.x, corner.y);
    }
    boxes.push_back(box);
  }
  return boxes;
}

std::optional<GroundGrid> toGroundGrid(const nav_msgs::OccupancyGridConstPtr& message,
                                       const Eigen::Isometry3d& T_map_frame)
{
  const nav_msgs::MapMetaData& info = message->info;
  GroundGrid grid;
  grid.T_map_grid = toPose2(T_map_frame * toIsometry(info.origin));
  grid.stamp_ns = toNs(message->header.stamp);
  grid.cell_m = static_cast<double>(info.resolution);
  if (!(grid.cell_m > 0.0) || !grid.T_map_grid.finite() ||
      message->data.size() != static_cast<size_t>(info.width) * static_cast<size_t>(info.height) ||
      message->data.empty())
  {
    return std::nullopt;
  }
  grid.width = static_cast<int>(info.width);
  grid.height = static_cast<int>(info.height);
  grid.cells = std::shared_ptr<const std::vector<int8_t>>(&message->data, [message](const auto*) {});
  return grid;
}

nav_msgs::Path toMsg(const Path& path, double step, const ros::Time& stamp, const std::string& map_frame)
{
  nav_msgs::Path message;
  message.header.stamp = stamp;
  message.header.frame_id = map_frame;
  if (path.empty())
  {
    return message;
  }
  geometry_msgs::PoseStamped pose;
  pose.header = message.header;
  const auto count = static_cast<size_t>(std::max(1.0, std::ceil(path.length() / step)));
  message.poses.reserve(count + 1);
  for (size_t i = 0; i <= count; ++i)
  {
    const PathPoint point = i == count ? path.points().back()
                                       : path.at(path.length() * static_cast<double>(i) / static_cast<double>(count));
    pose.pose = toPose(point.pose());
    message.poses.push_back(pose);
  }
  return message;
}

DriveFeedback toFeedback(const NavigatorOutput& output, double measured_speed)
{
  DriveFeedback feedback;
  feedback.progress = output.progress;
  feedback.distance_to_goal = output.distance_to_goal;
  feedback.speed = measured_speed;
  feedback.state = toString(output.state);
  feedback.reason = output.command.reason;
  return feedback;
}

visualization_msgs::MarkerArray toMarkers(const NavigationView& view)
{
  visualization_msgs::MarkerArray array;
  if (view.way.size() >= 2)
  {
    Marker way = makeMarker(view.base_link_frame, "way_ahead", Marker::LINE_STRIP, 0.1, view.output);
    for (const Pose2& pose : view.way)
    {
      way.points.push_back(toPoint(pose.x, pose.y, 0.05));
    }
    array.markers.push_back(way);
  }
  if (view.look_ahead)
  {
    array.markers.push_back(makeMarker(view.map_frame, "look_ahead", Marker::SPHERE, 0.3, view.output));
    array.markers.back().pose.position = toPoint(view.look_ahead->x(), view.look_ahead->y(), 0.1);
  }
  if (view.obstacles && view.output.obstacle_id >= 0)
  {
    const auto& obstacles = view.obstacles->obstacles;
    const auto found =
        std::find_if(obstacles.begin(), obstacles.end(),
                     [&view](const pi_detect::Obstacle3D& obstacle) { return obstacle.id == view.output.obstacle_id; });
    if (found != obstacles.end())
    {
      array.markers.push_back(found->outline.empty() ? boxOf(*found, view) : edgesOf(*found, view));
      array.markers.back().header = view.obstacles->header;
    }
  }
  if (view.output.state != NavigatorState::IDLE)
  {
    Marker text = makeMarker(view.base_link_frame, "state", Marker::TEXT_VIEW_FACING, 0.4, view.output);
    text.pose.position = toPoint(0.0, 0.0, 2.0);
    text.text = std::string(toString(view.output.state)) + ": " + view.output.command.reason;
    array.markers.push_back(text);
  }
  return array;
}

std::string withoutSlash(const std::string& frame)
{
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

}  // namespace pi_vehicle
