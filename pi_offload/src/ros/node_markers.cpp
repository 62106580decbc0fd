#include "ros/node_markers.h"
#include <pi_node/formatting.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>

namespace pi_offload
{
namespace
{

using pi_node::format;
using visualization_msgs::Marker;

constexpr char NODES[] = "nodes";
constexpr char RANGES[] = "ranges";
constexpr char NAMES[] = "names";
constexpr char LINKS[] = "links";
constexpr double NODE_WIDTH_M = 1.0;
constexpr double NODE_HEIGHT_M = 4.0;
constexpr double TEXT_HEIGHT_M = 1.0;
constexpr double LINE_WIDTH_M = 0.15;
constexpr int CIRCLE_STEPS = 72;

std_msgs::ColorRGBA colour(float red, float green, float blue, float alpha)
{
  std_msgs::ColorRGBA rgba;
  rgba.r = red;
  rgba.g = green;
  rgba.b = blue;
  rgba.a = alpha;
  return rgba;
}

std_msgs::ColorRGBA colourOf(const OffloadEngine::NodeStatus& node, bool used)
{
  if (!node.connected)
  {
    return colour(0.5F, 0.5F, 0.5F, 1.0F);
  }
  if (!node.in_range)
  {
    return colour(1.0F, 0.6F, 0.0F, 1.0F);
  }
  return used ? colour(0.0F, 0.8F, 0.2F, 1.0F) : colour(0.2F, 0.4F, 1.0F, 1.0F);
}

geometry_msgs::Point pointAt(double x, double y, double z)
{
  geometry_msgs::Point point;
  point.x = x;
  point.y = y;
  point.z = z;
  return point;
}

std::string textOf(const OffloadEngine::NodeStatus& node)
{
  if (!node.connected)
  {
    return node.description.id + " not connected";
  }
  const double queue_s = *std::max_element(node.queue_s.begin(), node.queue_s.end());
  return node.description.id + format(" %.1f ms", 1e3 * node.round_trip_s) + format(", queue %.0f ms", 1e3 * queue_s);
}

}  // namespace

visualization_msgs::MarkerArrayPtr NodeMarkers::update(const std::vector<OffloadEngine::NodeStatus>& nodes,
                                                       const VehicleState& vehicle,
                                                       const std::array<std::string, TASK_KINDS>& used,
                                                       const ros::Time& stamp)
{
  const auto array = boost::make_shared<visualization_msgs::MarkerArray>();
  std::set<Shown> shown;
  const auto add = [&](const char* group, int32_t id, int32_t type) -> Marker&
  {
    Marker marker;
    marker.header.frame_id = map_frame_;
    marker.header.stamp = stamp;
    marker.ns = group;
    marker.id = id;
    marker.type = type;
    marker.action = Marker::ADD;
    marker.pose.orientation.w = 1.0;
    shown.insert({group, id});
    array->markers.push_back(marker);
    return array->markers.back();
  };
  for (const OffloadEngine::NodeStatus& node : nodes)
  {
    auto place = std::find(ids_.begin(), ids_.end(), node.description.id);
    if (place == ids_.end())
    {
      place = ids_.insert(ids_.end(), node.description.id);
    }
    const auto id = static_cast<int32_t>(place - ids_.begin());
    const double x = node.description.position.x;
    const double y = node.description.position.y;
    const bool in_use = std::find(used.begin(), used.end(), node.description.id) != used.end();
    const std_msgs::ColorRGBA rgba = colourOf(node, in_use);

    Marker& body = add(NODES, id, Marker::CYLINDER);
    body.pose.position = pointAt(x, y, 0.5 * NODE_HEIGHT_M);
    body.scale.x = body.scale.y = NODE_WIDTH_M;
    body.scale.z = NODE_HEIGHT_M;
    body.color = rgba;

    Marker& name = add(NAMES, id, Marker::TEXT_VIEW_FACING);
    name.pose.position = pointAt(x, y, NODE_HEIGHT_M + TEXT_HEIGHT_M);
    name.scale.z = TEXT_HEIGHT_M;
    name.color = colour(1.0F, 1.0F, 1.0F, 1.0F);
    name.text = textOf(node);

    if (std::isfinite(node.description.range_m))
    {
      Marker& range = add(RANGES, id, Marker::LINE_STRIP);
      range.scale.x = LINE_WIDTH_M;
      range.color = rgba;
      range.color.a = 0.5F;
      for (int step = 0; step <= CIRCLE_STEPS; ++step)
      {
        const double angle = 2.0 * M_PI * step / CIRCLE_STEPS;
        range.points.push_back(pointAt(x + node.description.range_m * std::cos(angle),
                                       y + node.description.range_m * std::sin(angle), 0.0));
      }
    }
    if (in_use && vehicle.known)
    {
      Marker& link = add(LINKS, id, Marker::LINE_STRIP);
      link.scale.x = 2.0 * LINE_WIDTH_M;
      link.color = rgba;
      link.points = {pointAt(vehicle.position.x, vehicle.position.y, 1.0), pointAt(x, y, NODE_HEIGHT_M)};
    }
  }
  for (const Shown& before : shown_)
  {
    if (shown.count(before) == 0)
    {
      add(before.group.c_str(), before.id, Marker::CUBE).action = Marker::DELETE;
      shown.erase(before);
    }
  }
  shown_ = std::move(shown);
  return array;
}

}  // namespace pi_offload
