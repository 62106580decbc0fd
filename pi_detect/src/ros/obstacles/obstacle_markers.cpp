#include "ros/obstacles/obstacle_markers.h"
#include <pi_node/formatting.h>
#include "detector/draw_detections.h"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <string>

namespace pi_detect
{
namespace
{

using pi_node::format;

using visualization_msgs::Marker;

constexpr char BOXES[] = "obstacles";
constexpr char TEXTS[] = "labels";
constexpr char ARROWS[] = "velocities";
constexpr double MIN_SIZE_M = 0.01;  ///< of a box: rviz warns of flat ones
constexpr double TEXT_HEIGHT_M = 0.3;
constexpr double ARROW_WIDTH_M = 0.08;

/// Markers have 32 bit for the id.
int32_t markerId(int64_t id)
{
  return static_cast<int32_t>(id & INT32_MAX);
}

std_msgs::ColorRGBA colour(int64_t class_id, float alpha)
{
  std_msgs::ColorRGBA rgba;
  rgba.r = rgba.g = rgba.b = 0.6F;
  rgba.a = alpha;
  if (class_id >= 0)
  {
    const cv::Scalar bgr = colourOf(static_cast<int>(class_id));
    rgba.r = static_cast<float>(bgr[2] / 255.0);
    rgba.g = static_cast<float>(bgr[1] / 255.0);
    rgba.b = static_cast<float>(bgr[0] / 255.0);
  }
  return rgba;
}

Marker makeMarker(const std_msgs::Header& header, const char* group, int32_t id, int32_t type)
{
  Marker marker;
  marker.header = header;
  marker.ns = group;
  marker.id = id;
  marker.type = type;
  marker.action = Marker::ADD;
  marker.pose.orientation.w = 1.0;
  return marker;
}

/// The outline, as high as the box; the box where there is none.
Marker makeBody(const std_msgs::Header& header, int32_t id, const Obstacle3D& obstacle)
{
  const size_t corners = obstacle.outline.size();
  if (corners < 3)
  {
    Marker box = makeMarker(header, BOXES, id, Marker::CUBE);
    box.pose.position = obstacle.position;
    box.scale.x = std::max(MIN_SIZE_M, obstacle.size.x);
    box.scale.y = std::max(MIN_SIZE_M, obstacle.size.y);
    box.scale.z = std::max(MIN_SIZE_M, obstacle.size.z);
    return box;
  }
  Marker prism = makeMarker(header, BOXES, id, Marker::TRIANGLE_LIST);
  prism.scale.x = prism.scale.y = prism.scale.z = 1.0;
  const auto at = [&](size_t corner, double height)
  {
    const geometry_msgs::Point32& from = obstacle.outline[corner % corners];
    geometry_msgs::Point point;
    point.x = from.x;
    point.y = from.y;
    point.z = from.z + height;
    return point;
  };
  const double height = std::max(MIN_SIZE_M, obstacle.size.z);
  for (size_t i = 0; i < corners; ++i)
  {
    // A side of two triangles, and one of the top.
    prism.points.insert(prism.points.end(), {at(i, 0.0), at(i + 1, 0.0), at(i + 1, height)});
    prism.points.insert(prism.points.end(), {at(i, 0.0), at(i + 1, height), at(i, height)});
    if (i >= 1 && i + 1 < corners)
    {
      prism.points.insert(prism.points.end(), {at(0, height), at(i, height), at(i + 1, height)});
    }
  }
  return prism;
}

void deleteVanished(const std_msgs::Header& header, const char* group, const std::set<int32_t>& before,
                    const std::set<int32_t>& now, visualization_msgs::MarkerArray* array)
{
  for (const int32_t id : before)
  {
    if (now.count(id) == 0)
    {
      array->markers.push_back(makeMarker(header, group, id, Marker::CUBE));
      array->markers.back().action = Marker::DELETE;
    }
  }
}

}  // namespace

ObstacleMarkers::ObstacleMarkers(double lifetime_s) : lifetime_s_(lifetime_s) {}

visualization_msgs::MarkerArrayPtr ObstacleMarkers::update(const ObstacleArray& obstacles)
{
  const auto array = boost::make_shared<visualization_msgs::MarkerArray>();
  const ros::Duration lifetime(lifetime_s_);
  std::set<int32_t> boxes;
  std::set<int32_t> arrows;
  for (const auto& obstacle : obstacles.obstacles)
  {
    const int32_t id = markerId(obstacle.id);
    boxes.insert(id);
    Marker box = makeBody(obstacles.header, id, obstacle);
    box.color = colour(obstacle.class_id, 0.5F);
    box.lifetime = lifetime;
    array->markers.push_back(box);

    Marker text = makeMarker(obstacles.header, TEXTS, id, Marker::TEXT_VIEW_FACING);
    text.pose.position = obstacle.position;
    text.pose.position.z += 0.5 * obstacle.size.z + TEXT_HEIGHT_M;
    text.scale.z = TEXT_HEIGHT_M;
    text.color = colour(obstacle.class_id, 1.0F);
    text.lifetime = lifetime;
    text.text = "#" + std::to_string(obstacle.id) + (obstacle.label.empty() ? "" : " " + obstacle.label) +
                format(" %.1f m", obstacle.distance);
    if (std::isfinite(obstacle.time_to_collision))
    {
      text.text += format(" %.1f s", obstacle.time_to_collision);
    }
    array->markers.push_back(text);

    if (!obstacle.moving)
    {
      continue;
    }
    arrows.insert(id);
    Marker arrow = makeMarker(obstacles.header, ARROWS, id, Marker::ARROW);
    geometry_msgs::Point tip = obstacle.position;
    tip.x += obstacle.velocity.x;
    tip.y += obstacle.velocity.y;
    tip.z += obstacle.velocity.z;
    arrow.points = {obstacle.position, tip};
    arrow.scale.x = ARROW_WIDTH_M;
    arrow.scale.y = 2.0 * ARROW_WIDTH_M;
    arrow.color = colour(obstacle.class_id, 1.0F);
    arrow.lifetime = lifetime;
    array->markers.push_back(arrow);
  }
  deleteVanished(obstacles.header, BOXES, boxes_, boxes, array.get());
  deleteVanished(obstacles.header, TEXTS, boxes_, boxes, array.get());
  deleteVanished(obstacles.header, ARROWS, arrows_, arrows, array.get());
  boxes_ = boxes;
  arrows_ = arrows;
  return array;
}

}  // namespace pi_detect
