#pragma once

#include <Eigen/Core>
#include <cmath>

namespace pi_vehicle
{

/// Brings an angle into [-pi, pi]. NaN stays NaN.
inline double wrapAngle(double angle)
{
  return std::remainder(angle, 2.0 * M_PI);
}

/// A pose on the ground: T_a_b, which maps coordinates of b into a.
struct Pose2
{
  double x = 0.0;        ///< [m]
  double y = 0.0;        ///< [m]
  double heading = 0.0;  ///< of b's x axis in a [rad]

  Eigen::Vector2d position() const { return {x, y}; }
  bool finite() const { return std::isfinite(x) && std::isfinite(y) && std::isfinite(heading); }

  /// The point p of frame b, in a.
  Eigen::Vector2d operator*(const Eigen::Vector2d& p) const
  {
    const double c = std::cos(heading);
    const double s = std::sin(heading);
    return {x + c * p.x() - s * p.y(), y + s * p.x() + c * p.y()};
  }

  /// T_a_c = T_a_b * T_b_c.
  Pose2 operator*(const Pose2& b) const
  {
    const Eigen::Vector2d p = *this * b.position();
    return {p.x(), p.y(), wrapAngle(heading + b.heading)};
  }

  Pose2 inverse() const
  {
    const double c = std::cos(heading);
    const double s = std::sin(heading);
    return {-c * x - s * y, s * x - c * y, wrapAngle(-heading)};
  }

  /// The pose after `distance` [m] along an arc of `curvature` [1/m] (left positive).
  Pose2 moved(double distance, double curvature) const { return turned(distance, distance * curvature); }

  /// The pose after `distance` [m] along an arc that turns by `turn` [rad] (left positive); also on the spot.
  Pose2 turned(double distance, double turn) const
  {
    const double half = 0.5 * turn;
    const double chord = std::abs(half) < 1e-6 ? distance : distance * std::sin(half) / half;
    return {x + chord * std::cos(heading + half), y + chord * std::sin(heading + half), wrapAngle(heading + turn)};
  }
};

}  // namespace pi_vehicle
