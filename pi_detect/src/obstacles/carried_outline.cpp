#include "obstacles/carried_outline.h"

#include <algorithm>
#include <utility>

namespace pi_detect::obstacles
{

namespace
{

constexpr double GROWTH_M = 0.4;        // from one measurement to the next
constexpr int64_t KEPT_NS = 120000000;  // of what was shown
constexpr int64_t KEPT_WHERE_CUT_NS = 500000000;

void shift(const Eigen::Vector2d& by, Outline* outline)
{
  for (Eigen::Vector2d& corner : *outline)
  {
    corner += by;
  }
}

/// What two have in common, if one of them is so much larger on all sides.
Outline common(const Outline& outline, const Outline& other, double larger)
{
  Outline part = outline;
  for (size_t i = 0; i < other.size() && !part.empty(); ++i)
  {
    const Eigen::Vector2d side = (other[(i + 1) % other.size()] - other[i]).normalized();
    const Eigen::Vector2d outward(side.y(), -side.x());
    const Eigen::Vector2d from = other[i] + larger * outward;
    if (std::any_of(part.begin(), part.end(),
                    [&](const Eigen::Vector2d& corner) { return outward.dot(corner - from) > 0.0; }))
    {
      part = leftOf(part, from, side);
    }
  }
  return part;
}

}  // namespace

void CarriedOutline::take(int64_t stamp_ns, const Outline& measured, const VehiclePlace& vehicle,
                          const Eigen::Vector2d& position)
{
  measured_.clear();
  for (const Eigen::Vector2d& corner : measured)
  {
    measured_.push_back(vehicle.toOdom(corner) - position);
  }
  shown_ = measured_;
  seen_.assign(1, {stamp_ns, measured_});
}

void CarriedOutline::correct(int64_t stamp_ns, const Outline& measured, const VehiclePlace& vehicle,
                             const Eigen::Vector2d& position, const Eigen::Vector2d& moved, bool cut)
{
  Outline last = std::move(measured_);
  std::vector<Seen> seen = std::move(seen_);
  take(stamp_ns, measured, vehicle, position);
  if (last.empty() || measured_.empty())
  {
    return;
  }
  shift(-moved, &last);
  Outline confirmed = common(measured_, last, GROWTH_M);
  if (confirmed.empty())
  {
    return;
  }
  const int64_t oldest_ns = stamp_ns - (cut ? KEPT_WHERE_CUT_NS : KEPT_NS);
  seen.erase(
      std::remove_if(seen.begin(), seen.end(), [oldest_ns](const Seen& one) { return one.stamp_ns < oldest_ns; }),
      seen.end());
  std::vector<Eigen::Vector2d> points = confirmed;
  for (Seen& one : seen)
  {
    shift(-moved, &one.outline);
    points.insert(points.end(), one.outline.begin(), one.outline.end());
  }
  seen.push_back({stamp_ns, std::move(confirmed)});
  seen_ = std::move(seen);
  shown_ = convexHull(std::move(points));
  limitCorners(&shown_);
}

Outline CarriedOutline::at(const Eigen::Vector2d& position, const VehiclePlace& vehicle) const
{
  Outline outline;
  outline.reserve(shown_.size());
  for (const Eigen::Vector2d& corner : shown_)
  {
    outline.push_back(vehicle.toBase(position + corner));
  }
  return outline;
}

}  // namespace pi_detect::obstacles
