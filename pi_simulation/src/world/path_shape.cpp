#include "world/path_shape.h"

#include <cmath>

namespace pi_simulation
{
namespace
{

constexpr double STEP_M = PathLine::STEP_M;

/// Corner points or curve of a shape; closed shapes do not repeat their first point.
std::vector<Eigen::Vector2d> outline(PathShape shape)
{
  std::vector<Eigen::Vector2d> points;
  if (shape == PathShape::FIGURE_EIGHT)
  {
    for (int i = 0; i < 2000; ++i)  // lemniscate of Gerono
    {
      const double a = 2.0 * M_PI * i / 2000.0;
      points.emplace_back(22.0 * std::sin(a), 22.0 * std::sin(a) * std::cos(a));
    }
    return points;
  }
  const bool campus = shape == PathShape::CAMPUS_LOOP;
  const double length = campus ? 75.0 : 22.0;
  const double width = campus ? 45.0 : 12.0;
  const double radius = campus ? 9.0 : 3.5;
  const Eigen::Vector2d centres[] = {
      {length - radius, radius}, {length - radius, width - radius}, {radius, width - radius}, {radius, radius}};
  points.emplace_back(0.3 * length, 0.0);  // sets off on a straight
  for (int corner = 0; corner < 4; ++corner)
  {
    for (int i = 0; i <= 60; ++i)
    {
      const double a = 0.5 * M_PI * (corner - 1 + i / 60.0);
      points.emplace_back(centres[corner] + radius * Eigen::Vector2d(std::cos(a), std::sin(a)));
    }
  }
  return points;
}

double perimeter(const std::vector<Eigen::Vector2d>& corners)
{
  double length = (corners.front() - corners.back()).norm();
  for (size_t i = 1; i < corners.size(); ++i)
  {
    length += (corners[i] - corners[i - 1]).norm();
  }
  return length;
}

/// Points at equal distance along a closed polygon, about `step` apart, so that a whole number fits.
std::vector<Eigen::Vector2d> resample(const std::vector<Eigen::Vector2d>& corners, double step)
{
  const double length = perimeter(corners);
  const auto count = static_cast<size_t>(std::round(length / step));
  const double exact_step = length / static_cast<double>(count);
  std::vector<Eigen::Vector2d> points;
  double before = 0.0;  // length up to the corner
  for (size_t i = 0; i < corners.size(); ++i)
  {
    const Eigen::Vector2d a = corners[i];
    const Eigen::Vector2d edge = corners[(i + 1) % corners.size()] - a;
    const double after = before + edge.norm();
    while (points.size() < count && exact_step * static_cast<double>(points.size()) <= after)
    {
      const double s = exact_step * static_cast<double>(points.size()) - before;
      points.emplace_back(edge.norm() > 0.0 ? Eigen::Vector2d(a + edge * (s / edge.norm())) : a);
    }
    before = after;
  }
  return points;
}

/// Mean over a window along the closed line: turns the corners' steps of curvature into ramps.
std::vector<Eigen::Vector2d> smoothed(const std::vector<Eigen::Vector2d>& points, double window_m)
{
  const auto count = static_cast<int>(points.size());
  const int half = static_cast<int>(0.5 * window_m / STEP_M);
  std::vector<Eigen::Vector2d> result(points.size(), Eigen::Vector2d::Zero());
  for (int i = 0; i < count; ++i)
  {
    for (int k = -half; k <= half; ++k)
    {
      result[static_cast<size_t>(i)] += points[static_cast<size_t>((i + k + count) % count)];
    }
    result[static_cast<size_t>(i)] /= 2.0 * half + 1.0;
  }
  return result;
}

}  // namespace

bool isClosed(PathShape shape)
{
  return shape != PathShape::STRAIGHT;
}

PathLine::PathLine(PathShape shape)
{
  if (isClosed(shape))
  {
    points_ = resample(smoothed(resample(outline(shape), STEP_M), 4.0), STEP_M);
    step_m_ = perimeter(points_) / static_cast<double>(points_.size());
  }
}

Eigen::Vector2d PathLine::at(double s) const
{
  if (points_.empty())
  {
    return {s, 0.0};
  }
  const double index = s / step_m_;
  const double floor = std::floor(index);
  const auto count = static_cast<long>(points_.size());
  const long i = ((static_cast<long>(floor) % count) + count) % count;
  const double f = index - floor;
  return (1.0 - f) * points_[static_cast<size_t>(i)] + f * points_[static_cast<size_t>((i + 1) % count)];
}

std::vector<Eigen::Vector2d> pathLine(PathShape shape, double length_m)
{
  const PathLine line(shape);
  const double length = isClosed(shape) ? line.length() : length_m;
  std::vector<Eigen::Vector2d> points;
  for (double s = 0.0; s < length; s += 0.25)
  {
    points.push_back(line.at(s));
  }
  return points;
}

}  // namespace pi_simulation
