#include "decision/path.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_vehicle
{

Path::Path(const std::vector<Eigen::Vector2d>& points, bool closed) : closed_(closed)
{
  const size_t least = closed ? 3 : 2;
  if (points.size() < least)
  {
    throw std::invalid_argument("path has " + std::to_string(points.size()) + " points, must have at least " +
                                std::to_string(least));
  }
  const size_t count = points.size() + (closed ? 1 : 0);
  points_.resize(count);
  for (size_t i = 0; i < count; ++i)
  {
    const Eigen::Vector2d& p = points[i % points.size()];
    if (!p.allFinite())
    {
      throw std::invalid_argument("path point " + std::to_string(i) + " is not finite: give numbers");
    }
    points_[i].x = p.x();
    points_[i].y = p.y();
    if (i > 0)
    {
      const double step = (p - points[i - 1]).norm();
      if (step < 1e-6)
      {
        throw std::invalid_argument("path point " + std::to_string(i % points.size()) +
                                    " is the same as the one before: leave one out");
      }
      points_[i].s = points_[i - 1].s + step;
    }
  }
  length_ = points_.back().s;

  const auto segment = [this](size_t i)
  { return std::atan2(points_[i + 1].y - points_[i].y, points_[i + 1].x - points_[i].x); };
  const size_t last = count - 1;
  for (size_t i = 0; i < count; ++i)
  {
    const bool end = i == 0 || i == last;
    if (end && !closed)
    {
      points_[i].heading = segment(i == 0 ? 0 : last - 1);
      continue;
    }
    const size_t before = end ? last - 1 : i - 1;
    const size_t after = end ? 0 : i;
    const double length_before = points_[before + 1].s - points_[before].s;
    const double length_after = points_[after + 1].s - points_[after].s;
    const double turn = wrapAngle(segment(after) - segment(before));
    points_[i].heading = wrapAngle(segment(before) + turn * length_before / (length_before + length_after));
    points_[i].curvature = 2.0 * turn / (length_before + length_after);
  }
  if (!closed && count > 2)
  {
    points_.front().curvature = points_[1].curvature;
    points_.back().curvature = points_[last - 1].curvature;
    // The end tangents: half a segment's turn further out than the middle of the segment.
    points_.front().heading -= 0.5 * points_[1].s * points_.front().curvature;
    points_.back().heading += 0.5 * (points_[last].s - points_[last - 1].s) * points_.back().curvature;
  }
}

double Path::wrap(double s) const
{
  if (!closed_)
  {
    return std::clamp(s, 0.0, length_);
  }
  s = std::fmod(s, length_);
  return s < 0.0 ? s + length_ : s;
}

size_t Path::segmentAt(double s) const
{
  const auto after =
      std::upper_bound(points_.begin(), points_.end(), s, [](double value, const PathPoint& p) { return value < p.s; });
  const auto index = static_cast<size_t>(after - points_.begin());
  return std::min(index == 0 ? 0 : index - 1, points_.size() - 2);
}

PathPoint Path::at(double s) const
{
  s = wrap(s);
  const size_t i = segmentAt(s);
  const PathPoint& a = points_[i];
  const PathPoint& b = points_[i + 1];
  const double part = (s - a.s) / (b.s - a.s);
  PathPoint p;
  p.x = a.x + part * (b.x - a.x);
  p.y = a.y + part * (b.y - a.y);
  p.heading = wrapAngle(a.heading + part * wrapAngle(b.heading - a.heading));
  p.curvature = a.curvature + part * (b.curvature - a.curvature);
  p.s = s;
  return p;
}

PathProjection Path::project(const Pose2& pose, double from, double to, double heading_weight) const
{
  if (!closed_)
  {
    from = std::clamp(from, 0.0, length_);
    to = std::clamp(to, 0.0, length_);
  }
  else
  {
    to = std::min(to, from + length_);
  }
  const Eigen::Vector2d p = pose.position();
  double least = std::numeric_limits<double>::infinity();
  double best_s = from;
  double s = from;
  // From segment to segment, the first and last cut at `from` and `to`.
  while (true)
  {
    const double inside = wrap(s);
    const size_t i = segmentAt(inside);
    const PathPoint& a = points_[i];
    const PathPoint& b = points_[i + 1];
    const double length = b.s - a.s;
    const Eigen::Vector2d direction = (b.pose().position() - a.pose().position()) / length;
    const double low = inside - a.s;
    const double high = std::min(length, low + (to - s));
    const double along = std::clamp((p - a.pose().position()).dot(direction), low, std::max(low, high));
    const double distance = (a.pose().position() + along * direction - p).norm();
    double cost = distance;
    if (heading_weight > 0.0)
    {
      cost += heading_weight * std::abs(wrapAngle(pose.heading - std::atan2(direction.y(), direction.x())));
    }
    if (cost < least)
    {
      least = cost;
      best_s = a.s + along;
    }
    const double next = s + std::max(length - low, 1e-9);
    if (next >= to)
    {
      break;
    }
    s = next;
  }
  const PathPoint nearest = at(best_s);
  PathProjection projection;
  projection.s = nearest.s;
  const Eigen::Vector2d offset = p - nearest.pose().position();
  projection.cross_track = -std::sin(nearest.heading) * offset.x() + std::cos(nearest.heading) * offset.y();
  projection.heading_error = wrapAngle(pose.heading - nearest.heading);
  return projection;
}

PathProjection Path::project(const Pose2& pose, double heading_weight) const
{
  return project(pose, 0.0, length_, heading_weight);
}

}  // namespace pi_vehicle
