#pragma once

#include <Eigen/Geometry>

#include "map/place_verifier.h"

namespace pi_slam::map
{

/// Where the body is in map, from odometry, which drifts, and recognised places: a Kalman filter of position and
/// heading. Not thread safe.
class DriftFilter
{
public:
  /// Difference between a recognised place and the filter.
  struct Innovation
  {
    double distance_m = 0.0;
    double angle_rad = 0.0;
    double chi2 = 0.0;  ///< 4 degrees of freedom
  };

  /// Starts again with odometry's pose at this time and its place in map.
  void start(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_odom,
             const Eigen::Matrix4d& covariance);
  /// The body moved to T_odom_body.
  void predict(const Eigen::Isometry3d& T_odom_body);
  Innovation innovation(const PlaceMatch& place) const;
  void update(const PlaceMatch& place);
  /// The map moved under the body; the covariance stays.
  void move(const Eigen::Isometry3d& T_map_odom) { T_map_odom_ = T_map_odom; }

  /// The map moved, turned about z, with the body in it: the covariance turns along.
  void turn(const Eigen::Isometry3d& T_map_odom);

  const Eigen::Isometry3d& T_map_odom() const { return T_map_odom_; }
  Eigen::Isometry3d T_map_body() const { return T_map_odom_ * T_odom_body_; }
  /// Of x, y, z of the body in map [m], heading [rad].
  const Eigen::Matrix4d& covariance() const { return covariance_; }

private:
  Eigen::Vector4d difference(const PlaceMatch& place) const;

  Eigen::Isometry3d T_odom_body_ = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_map_odom_ = Eigen::Isometry3d::Identity();
  Eigen::Matrix4d covariance_ = Eigen::Matrix4d::Zero();
};

}  // namespace pi_slam::map
