#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <cstdint>
#include <deque>
#include <optional>

namespace pi_vehicle
{

/// The way by the wheels over the last while. Of wheel odometry the motion between two messages counts, not the pose: a
/// chassis that begins anew at the origin breaks nothing. Not thread safe.
class WheelTrack
{
public:
  struct Point
  {
    int64_t stamp_ns = 0;
    Pose2 pose;             ///< in a frame of this object
    double distance = 0.0;  ///< driven forwards and backwards [m]
    double speed = 0.0;     ///< [m/s]
    double yaw_rate = 0.0;  ///< [rad/s]
  };

  /// @param max_speed  of the vehicle; what would be faster is a jump, and bridged by the speed [m/s].
  /// @param length_s   of the way that is kept [s].
  WheelTrack(double max_speed, double length_s) : max_speed_(max_speed), length_s_(length_s) {}

  /// @return false: left out, as it is not finite or not newer than the one before.
  bool add(int64_t stamp_ns, const Pose2& pose, double speed, double yaw_rate);
  void clear() { points_.clear(); }

  /// Between the points around the stamp; up to extrapolate_s after the newest by its speed. nullopt: unknown.
  std::optional<Point> at(int64_t stamp_ns, double extrapolate_s) const;
  /// nullptr: nothing came yet.
  const Point* newest() const { return points_.empty() ? nullptr : &points_.back(); }
  bool covers(int64_t stamp_ns) const
  {
    return !points_.empty() && points_.front().stamp_ns <= stamp_ns && stamp_ns <= points_.back().stamp_ns;
  }

private:
  const double max_speed_;
  const double length_s_;
  Pose2 given_;  ///< of the newest point, as it came
  std::deque<Point> points_;
};

}  // namespace pi_vehicle
