#include "decision/wheel_track.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle
{

using pi_node::seconds;

namespace
{

constexpr double JUMP_MARGIN_M = 0.2;
constexpr double JUMP_MARGIN_RAD = 0.2;
constexpr double MAX_YAW_RATE = 3.0;  // of a vehicle that drives [rad/s]
constexpr double LONGEST_BRIDGE_S = 0.2;

WheelTrack::Point extrapolated(const WheelTrack::Point& from, double dt)
{
  WheelTrack::Point point = from;
  const double way = from.speed * dt;
  const double turn = from.yaw_rate * dt;
  point.stamp_ns += static_cast<int64_t>(1e9 * dt);
  const Eigen::Vector2d step(way * std::cos(0.5 * turn), way * std::sin(0.5 * turn));
  point.pose = from.pose * Pose2{step.x(), step.y(), turn};
  point.distance += std::abs(way);
  return point;
}

}  // namespace

bool WheelTrack::add(int64_t stamp_ns, const Pose2& pose, double speed, double yaw_rate)
{
  if (!pose.finite() || !std::isfinite(speed) || !std::isfinite(yaw_rate))
  {
    return false;
  }
  Point point;
  if (!points_.empty())
  {
    const Point& last = points_.back();
    if (stamp_ns <= last.stamp_ns)
    {
      return false;
    }
    const double dt = seconds(stamp_ns - last.stamp_ns);
    const Pose2 step = given_.inverse() * pose;
    const bool jumped = step.position().norm() > max_speed_ * dt + JUMP_MARGIN_M ||
                        std::abs(step.heading) > MAX_YAW_RATE * dt + JUMP_MARGIN_RAD;
    point = jumped ? extrapolated(last, std::min(dt, LONGEST_BRIDGE_S)) : last;
    if (!jumped)
    {
      point.pose = last.pose * step;
      point.distance += step.position().norm();
    }
  }
  point.stamp_ns = stamp_ns;
  point.speed = speed;
  point.yaw_rate = yaw_rate;
  given_ = pose;
  points_.push_back(point);
  while (seconds(stamp_ns - points_.front().stamp_ns) > length_s_)
  {
    points_.pop_front();
  }
  return true;
}

std::optional<WheelTrack::Point> WheelTrack::at(int64_t stamp_ns, double extrapolate_s) const
{
  const auto after = std::lower_bound(points_.begin(), points_.end(), stamp_ns,
                                      [](const Point& point, int64_t stamp) { return point.stamp_ns < stamp; });
  if (after == points_.end())
  {
    if (points_.empty() || seconds(stamp_ns - points_.back().stamp_ns) > extrapolate_s)
    {
      return std::nullopt;
    }
    return extrapolated(points_.back(), seconds(stamp_ns - points_.back().stamp_ns));
  }
  if (after->stamp_ns == stamp_ns)
  {
    return *after;
  }
  if (after == points_.begin())
  {
    return std::nullopt;
  }
  const Point& before = *std::prev(after);
  const double part = seconds(stamp_ns - before.stamp_ns) / seconds(after->stamp_ns - before.stamp_ns);
  Point point = before;
  point.stamp_ns = stamp_ns;
  point.pose.x += part * (after->pose.x - before.pose.x);
  point.pose.y += part * (after->pose.y - before.pose.y);
  point.pose.heading = wrapAngle(before.pose.heading + part * wrapAngle(after->pose.heading - before.pose.heading));
  point.distance += part * (after->distance - before.distance);
  return point;
}

}  // namespace pi_vehicle
