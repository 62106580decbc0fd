#pragma once

#include <pi_slam/imu_sample.h>

#include <Eigen/Geometry>
#include <cstdint>

namespace pi_slam
{

using Vector15d = Eigen::Matrix<double, 15, 1>;
using Matrix15d = Eigen::Matrix<double, 15, 15>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Where the body (the IMU) is in the odom frame (z up), how fast it moves, and the biases of its sensors.
///
/// Errors of a state, and so the order of rows in every 15x15 matrix of this package:
/// [d_p (0..2), d_theta (3..5), d_v (6..8), d_bg (9..11), d_ba (12..14)], with p = p^ + d_p, q = q^ exp(d_theta) (a
/// rotation in the body frame), the others additive.
struct NavState
{
  int64_t stamp_ns = 0;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();            ///< of the body in odom [m]
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  ///< R_odom_body
  Eigen::Vector3d v = Eigen::Vector3d::Zero();            ///< of the body in odom [m/s]
  ImuBias bias;

  Eigen::Isometry3d T_odom_body() const
  {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = q.toRotationMatrix();
    T.translation() = p;
    return T;
  }

  /// Adds an error of the order above.
  void boxPlus(const Vector15d& delta);
  /// The error that boxPlus() needs to come from `other` to this one.
  Vector15d boxMinus(const NavState& other) const;
  bool isFinite() const;
};

}  // namespace pi_slam
