#include "obstacles/obstacle_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_detect::obstacles
{

namespace
{

constexpr int RAYS = 13;           // through an outline
constexpr double HIDDEN_AT = 0.9;  // of a thing's distance, from which on nearer ones hide it
constexpr double LEAST_M2 = 0.02;  // smaller rests are none

}  // namespace

ObstacleView::ObstacleView(const std::vector<ObstacleMeasurement>& measurements, const StereoGeometry& geometry,
                           const Eigen::Isometry3d& T_base_left, double min_depth_m)
  : measurements_(measurements)
  , geometry_(geometry)
  , T_base_left_(T_base_left)
  , T_left_base_(T_base_left.inverse())
  , min_depth_m_(std::max(1e-3, min_depth_m))
{
}

bool ObstacleView::isExposed(const Eigen::Vector3d& p_base) const
{
  const Eigen::Vector3d p = T_left_base_ * p_base;
  if (p.z() < min_depth_m_)
  {
    return false;
  }
  const double u = geometry_.fx * p.x() / p.z() + geometry_.cx;
  const double v = geometry_.fy * p.y() / p.z() + geometry_.cy;
  // What is left of this has no partner in the right picture.
  const double left = geometry_.fx * geometry_.baseline_m / p.z();
  if (u < left || u >= geometry_.width || v < 0.0 || v >= geometry_.height)
  {
    return false;
  }
  return std::none_of(measurements_.begin(), measurements_.end(),
                      [&](const ObstacleMeasurement& other)
                      {
                        return other.box.x1 <= u && u <= other.box.x2 && other.box.y1 <= v && v <= other.box.y2 &&
                               other.nearest.head<2>().norm() < HIDDEN_AT * p_base.head<2>().norm();
                      });
}

Outline ObstacleView::hiddenPart(const Outline& outline, double z) const
{
  const Eigen::Vector2d camera = T_base_left_.translation().head<2>();
  const Eigen::Vector2d axis = T_base_left_.linear().col(2).head<2>().normalized();
  const Eigen::Vector2d left(-axis.y(), axis.x());
  // By the tangent of the angle to the axis, to the left.
  double least = std::numeric_limits<double>::infinity();
  double most = -least;
  for (const Eigen::Vector2d& corner : outline)
  {
    const Eigen::Vector2d p = corner - camera;
    if (p.dot(axis) < min_depth_m_)
    {
      return outline;  // beside the camera
    }
    least = std::min(least, p.dot(left) / p.dot(axis));
    most = std::max(most, p.dot(left) / p.dot(axis));
  }
  const auto direction = [&](int ray)
  { return Eigen::Vector2d(axis + (least + (most - least) * ray / (RAYS - 1)) * left); };
  int first = RAYS;
  int last = -1;
  for (int ray = 0; ray < RAYS; ++ray)
  {
    // The outermost rays touch a corner only.
    const Eigen::Vector2d way = direction(std::clamp(ray, 1, RAYS - 2));
    const double at = rayEntry(outline, camera, way);
    const Eigen::Vector2d p = camera + at * way;
    if (!std::isfinite(at) || !isExposed({p.x(), p.y(), z}))
    {
      first = std::min(first, ray);
      last = ray;
    }
  }
  Outline part = last < 0 ? Outline() : outline;
  if (!part.empty() && first > 0)
  {
    part = leftOf(part, camera, direction(first - 1));
  }
  if (!part.empty() && last < RAYS - 1)
  {
    part = leftOf(part, camera, -direction(last + 1));
  }
  return areaOf(part) < LEAST_M2 ? Outline() : part;
}

}  // namespace pi_detect::obstacles
