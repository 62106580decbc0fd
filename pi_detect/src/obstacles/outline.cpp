#include <pi_detect/outline.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_detect
{

namespace
{

constexpr double LINE_M2 = 1e-9;  // corners that turn by less are none

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b)
{
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

// Own code: OpenCV's takes float or whole numbers, and keeps corners that hardly turn.
Outline convexHull(std::vector<Eigen::Vector2d> points)
{
  std::sort(points.begin(), points.end(),
            [](const Eigen::Vector2d& a, const Eigen::Vector2d& b)
            { return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y()); });
  // Andrew's monotone chain: the lower side from left to right, then the upper one back.
  Outline hull;
  hull.reserve(points.size() + 1);
  const auto add = [&hull](const Eigen::Vector2d& point, size_t from)
  {
    while (hull.size() >= from + 2 &&
           cross(hull.back() - hull[hull.size() - 2], point - hull[hull.size() - 2]) <= LINE_M2)
    {
      hull.pop_back();
    }
    hull.push_back(point);
  };
  std::for_each(points.begin(), points.end(), [&](const Eigen::Vector2d& point) { add(point, 0); });
  const size_t upper = hull.empty() ? 0 : hull.size() - 1;
  std::for_each(points.rbegin(), points.rend(), [&](const Eigen::Vector2d& point) { add(point, upper); });
  if (hull.size() < 4)
  {
    return {};
  }
  hull.pop_back();  // the first one again
  return hull;
}

void limitCorners(Outline* outline, size_t most)
{
  while (outline->size() > std::max<size_t>(4, most))
  {
    // Without the side from a to b, its neighbours go on until they meet.
    const size_t n = outline->size();
    double least = std::numeric_limits<double>::infinity();
    size_t best = n;
    Eigen::Vector2d meeting = Eigen::Vector2d::Zero();
    for (size_t i = 0; i < n; ++i)
    {
      const Eigen::Vector2d& a = (*outline)[i];
      const Eigen::Vector2d& b = (*outline)[(i + 1) % n];
      const Eigen::Vector2d before = a - (*outline)[(i + n - 1) % n];
      const Eigen::Vector2d after = (*outline)[(i + 2) % n] - b;
      const double turn = cross(before, after);
      if (turn <= 0.0)
      {
        continue;
      }
      const Eigen::Vector2d q = a + cross(b - a, after) / turn * before;
      const double added = 0.5 * std::abs(cross(b - a, q - a));
      if (added < least)
      {
        least = added;
        best = i;
        meeting = q;
      }
    }
    if (best == n)
    {
      return;
    }
    (*outline)[best] = meeting;
    outline->erase(outline->begin() + static_cast<ptrdiff_t>((best + 1) % n));
  }
}

double areaOf(const Outline& outline)
{
  double twice = 0.0;
  for (size_t i = 0; i < outline.size(); ++i)
  {
    twice += cross(outline[i], outline[(i + 1) % outline.size()]);
  }
  return 0.5 * twice;
}

OutlineBounds boundsOf(const Outline& outline)
{
  OutlineBounds bounds{outline.front(), outline.front()};
  for (const Eigen::Vector2d& corner : outline)
  {
    bounds.low = bounds.low.cwiseMin(corner);
    bounds.high = bounds.high.cwiseMax(corner);
  }
  return bounds;
}

bool contains(const Outline& outline, const Eigen::Vector2d& point, double tolerance)
{
  for (size_t i = 0; i < outline.size(); ++i)
  {
    const Eigen::Vector2d side = outline[(i + 1) % outline.size()] - outline[i];
    if (cross(side, point - outline[i]) < -tolerance * side.norm())
    {
      return false;
    }
  }
  return !outline.empty();
}

double rayEntry(const Outline& outline, const Eigen::Vector2d& from, const Eigen::Vector2d& direction)
{
  double enters = 0.0;
  double leaves = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < outline.size(); ++i)
  {
    const Eigen::Vector2d side = outline[(i + 1) % outline.size()] - outline[i];
    const Eigen::Vector2d outward(side.y(), -side.x());
    const double speed = outward.dot(direction);
    const double gap = outward.dot(outline[i] - from);
    if (speed < 0.0)
    {
      enters = std::max(enters, gap / speed);
    }
    else if (speed > 0.0)
    {
      leaves = std::min(leaves, gap / speed);
    }
    else if (gap < 0.0)
    {
      return std::numeric_limits<double>::infinity();
    }
  }
  return enters <= leaves ? enters : std::numeric_limits<double>::infinity();
}

Outline leftOf(const Outline& outline, const Eigen::Vector2d& from, const Eigen::Vector2d& direction)
{
  Outline part;
  part.reserve(outline.size() + 1);
  for (size_t i = 0; i < outline.size(); ++i)
  {
    const Eigen::Vector2d& a = outline[i];
    const Eigen::Vector2d& b = outline[(i + 1) % outline.size()];
    const double at_a = cross(direction, a - from);
    const double at_b = cross(direction, b - from);
    if (at_a >= 0.0)
    {
      part.push_back(a);
    }
    if ((at_a > 0.0 && at_b < 0.0) || (at_a < 0.0 && at_b > 0.0))
    {
      part.push_back(a + at_a / (at_a - at_b) * (b - a));
    }
  }
  return part.size() < 3 ? Outline() : part;
}

}  // namespace pi_detect
