#include "vehicle/oriented_box.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace pi_simulation
{
namespace
{

Eigen::Vector2d axisOf(const OrientedBox& box)
{
  return {std::cos(box.heading), std::sin(box.heading)};
}

std::array<Eigen::Vector2d, 4> cornersOf(const OrientedBox& box)
{
  const Eigen::Vector2d x = axisOf(box) * box.half.x();
  const Eigen::Vector2d y = Eigen::Vector2d(-axisOf(box).y(), axisOf(box).x()) * box.half.y();
  return {box.center + x + y, box.center - x + y, box.center - x - y, box.center + x - y};
}

/// Separating axis test.
bool overlap(const OrientedBox& a, const OrientedBox& b)
{
  const Eigen::Vector2d way = b.center - a.center;
  const auto reach = [](const OrientedBox& box, const Eigen::Vector2d& axis)
  {
    const Eigen::Vector2d x = axisOf(box);
    return box.half.x() * std::abs(x.dot(axis)) + box.half.y() * std::abs(Eigen::Vector2d(-x.y(), x.x()).dot(axis));
  };
  for (const Eigen::Vector2d& x : {axisOf(a), axisOf(b)})
  {
    for (const Eigen::Vector2d& axis : {x, Eigen::Vector2d(-x.y(), x.x())})
    {
      if (std::abs(way.dot(axis)) > reach(a, axis) + reach(b, axis))
      {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

double distanceTo(const OrientedBox& box, const Eigen::Vector2d& point)
{
  const Eigen::Vector2d x = axisOf(box);
  const Eigen::Vector2d d = point - box.center;
  const Eigen::Vector2d local(std::abs(d.dot(x)), std::abs(d.dot(Eigen::Vector2d(-x.y(), x.x()))));
  return (local - box.half).cwiseMax(0.0).norm();
}

double distanceBetween(const OrientedBox& a, const OrientedBox& b)
{
  if (overlap(a, b))
  {
    return 0.0;
  }
  // Apart, a corner of one of them is nearest to the other.
  double nearest = distanceTo(a, cornersOf(b).front());
  for (const Eigen::Vector2d& corner : cornersOf(b))
  {
    nearest = std::min(nearest, distanceTo(a, corner));
  }
  for (const Eigen::Vector2d& corner : cornersOf(a))
  {
    nearest = std::min(nearest, distanceTo(b, corner));
  }
  return nearest;
}

}  // namespace pi_simulation
