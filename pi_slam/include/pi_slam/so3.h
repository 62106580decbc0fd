#pragma once

#include <Eigen/Geometry>

namespace pi_slam
{

/// exp and log of SO(3) with a rotation vector [rad]. exp gives a unit quaternion, log a vector of at most pi. log
/// takes quaternions of either sign and any length above 0.
Eigen::Quaterniond expSo3(const Eigen::Vector3d& phi);
Eigen::Vector3d logSo3(const Eigen::Quaterniond& q);

/// [a]x, so that hat(a) * b = a x b.
inline Eigen::Matrix3d hat(const Eigen::Vector3d& a)
{
  Eigen::Matrix3d matrix;
  matrix << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return matrix;
}

/// Right Jacobian of SO(3): exp(phi + d) = exp(phi) exp(rightJacobian(phi) d) for small d (Forster, Carlone, Dellaert
/// and Scaramuzza, TRO 2017, eq. 8), and its inverse (eq. 9), defined for |phi| < 2 pi.
Eigen::Matrix3d rightJacobian(const Eigen::Vector3d& phi);
Eigen::Matrix3d rightJacobianInverse(const Eigen::Vector3d& phi);

}  // namespace pi_slam
