#pragma once

#include <Eigen/Core>

namespace pi_simulation
{

/// A rectangle on the ground.
struct OrientedBox
{
  Eigen::Vector2d center = Eigen::Vector2d::Zero();  ///< [m]
  double heading = 0.0;                              ///< of its x axis [rad]
  Eigen::Vector2d half = Eigen::Vector2d::Zero();    ///< half sizes along its axes [m]
};

/// Shortest distance between two rectangles [m]; 0 if they overlap or touch.
double distanceBetween(const OrientedBox& a, const OrientedBox& b);

/// Shortest distance of a point to a rectangle [m]; 0 inside.
double distanceTo(const OrientedBox& box, const Eigen::Vector2d& point);

}  // namespace pi_simulation
