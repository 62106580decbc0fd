#include "drives/visible_obstacles.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <map>
#include <sstream>
#include <stdexcept>

namespace pi_simulation
{

namespace
{

struct Extent
{
  int left = 1 << 30;
  int top = 1 << 30;
  int right = -1;
  int bottom = -1;
  int pixels = 0;
  float nearest = 1e30f;
};

std::map<int, Extent> extentsOf(const StereoFrame& frame)
{
  std::map<int, Extent> extents;
  for (int y = 0; y < frame.objects.rows; ++y)
  {
    const auto* ids = frame.objects.ptr<int32_t>(y);
    const auto* depths = frame.depth.ptr<float>(y);
    for (int x = 0; x < frame.objects.cols; ++x)
    {
      if (ids[x] == 0)
      {
        continue;
      }
      Extent& extent = extents[ids[x]];
      extent.left = std::min(extent.left, x);
      extent.right = std::max(extent.right, x);
      extent.top = std::min(extent.top, y);
      extent.bottom = std::max(extent.bottom, y);
      extent.nearest = std::min(extent.nearest, depths[x]);
      ++extent.pixels;
    }
  }
  return extents;
}

void write(std::ostream& stream, const char* key, const Eigen::Vector3d& value)
{
  stream << ", \"" << key << "\": [" << value.x() << ", " << value.y() << ", " << value.z() << "]";
}

}  // namespace

std::vector<VisibleObstacle> visibleObstacles(const SyntheticWorld& world, const StereoFrame& frame,
                                              const Eigen::Isometry3d& T_world_body, int min_pixels)
{
  if (frame.objects.empty() || frame.depth.empty())
  {
    throw std::invalid_argument("visible obstacles: the frame has no truth; render with StereoRendererOptions::truth");
  }
  const std::map<int, Extent> extents = extentsOf(frame);
  const Eigen::Isometry3d T_body_world = T_world_body.inverse();
  std::vector<VisibleObstacle> visible;
  for (const ObstacleState& state : world.obstaclesAt(frame.stamp_ns))
  {
    const auto found = extents.find(state.id);
    if (found == extents.end() || found->second.pixels < min_pixels)
    {
      continue;
    }
    const Extent& extent = found->second;
    const Eigen::Isometry3d T_body_object = T_body_world * state.T_world_object;
    VisibleObstacle obstacle;
    obstacle.id = state.id;
    obstacle.class_name = state.class_name;
    obstacle.box = {extent.left, extent.top, extent.right + 1 - extent.left, extent.bottom + 1 - extent.top};
    obstacle.pixels = extent.pixels;
    obstacle.visible = static_cast<double>(extent.pixels) / frame.silhouettes.at(static_cast<size_t>(state.id));
    obstacle.nearest_depth_m = extent.nearest;
    obstacle.p_body = T_body_object.translation();
    obstacle.v_body = T_body_world.linear() * state.v_world;
    obstacle.size = state.size;
    obstacle.heading = std::atan2(T_body_object.linear()(1, 0), T_body_object.linear()(0, 0));
    visible.push_back(obstacle);
  }
  return visible;
}

std::string toJson(int64_t stamp_ns, const std::vector<VisibleObstacle>& obstacles)
{
  std::ostringstream stream;
  stream << std::fixed << std::setprecision(4) << "{\"stamp_ns\": " << stamp_ns << ", \"obstacles\": [";
  const char* separator = "";
  for (const VisibleObstacle& obstacle : obstacles)
  {
    stream << separator << "{\"id\": " << obstacle.id << ", \"class\": \"" << obstacle.class_name << "\", \"box\": ["
           << obstacle.box.x << ", " << obstacle.box.y << ", " << obstacle.box.br().x << ", " << obstacle.box.br().y
           << "], \"pixels\": " << obstacle.pixels << ", \"visible\": " << obstacle.visible
           << ", \"nearest_depth_m\": " << obstacle.nearest_depth_m;
    write(stream, "position", obstacle.p_body);
    write(stream, "velocity", obstacle.v_body);
    write(stream, "size", obstacle.size);
    stream << ", \"heading\": " << obstacle.heading << "}";
    separator = ", ";
  }
  stream << "]}";
  return stream.str();
}

}  // namespace pi_simulation
