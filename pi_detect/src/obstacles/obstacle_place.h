#pragma once

#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Core>

namespace pi_detect::obstacles
{

/// Pose of the vehicle on the ground plane of odom.
struct VehiclePlace
{
  Eigen::Matrix2d R_odom_base = Eigen::Matrix2d::Identity();
  Eigen::Vector2d p_odom_base = Eigen::Vector2d::Zero();

  Eigen::Vector2d toBase(const Eigen::Vector2d& p_odom) const
  {
    return R_odom_base.transpose() * (p_odom - p_odom_base);
  }
  Eigen::Vector2d toOdom(const Eigen::Vector2d& p_base) const { return R_odom_base * p_base + p_odom_base; }
};

/// Measured position of an obstacle in odom: the middle of the side that faces the vehicle.
struct Place
{
  Eigen::Vector2d position;
  Eigen::Matrix2d covariance;
};

constexpr double BULKY_M = 5.0;  ///< the middle of longer obstacles does not show their motion

/// Whether one of its two ends in y is the thing's own, which moves as the thing does, and the other is cut.
bool showsOneEnd(const ObstacleMeasurement& measurement);

/// Where one end is seen: the middle that the known width behind that end gives.
/// @param known_size   of the obstacle so far, along the axes of base_link.
/// @param most_edge_m  bound of the uncertainty [m] that is added for hidden or changed ends.
Place placeOf(const ObstacleMeasurement& measurement, const Eigen::Vector2d& known_size, const VehiclePlace& vehicle,
              double most_edge_m = 10.0);

/// On the ground, along the axes of base_link.
OutlineBounds footprintOf(const ObstacleMeasurement& measurement);

/// The intersection, as a part of the smaller one.
double commonPart(const OutlineBounds& a, const OutlineBounds& b);

}  // namespace pi_detect::obstacles
