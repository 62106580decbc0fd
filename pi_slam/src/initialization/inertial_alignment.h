#pragma once

#include "inertial/imu_preintegration.h"

#include <Eigen/Core>
#include <vector>

#include "initialization/stereo_odometry.h"

namespace pi_slam
{

/// Gyro bias that makes integrated rates agree with the rotations between poses: Gauss-Newton on the sum of
/// log(deltaR(bias)^T R_k^T R_k+1)^2 with Huber weights (Qin, Li and Shen, TRO 2018, section V.B.1).
/// @param integrals  between neighbouring poses, one fewer than these; reintegrated for the bias that is returned.
/// @param rms        of what is left, per interval [rad].
Eigen::Vector3d alignRotations(const std::vector<StereoOdometry::Pose>& poses,
                               std::vector<ImuPreintegration>* integrals, double* rms);

/// Rotation from one pose to the next.
inline Eigen::Quaterniond rotationBetween(const StereoOdometry::Pose& a, const StereoOdometry::Pose& b)
{
  return a.q.conjugate() * b.q;
}

/// Gravity and velocities, in the frame of the poses.
struct InertialAlignment
{
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();     ///< of known length [m/s^2]
  std::vector<Eigen::Vector3d> velocities;               ///< at each pose [m/s]
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();  ///< with a prior about 0 [m/s^2]
  double gravity_found = 0.0;                            ///< its length where it was free [m/s^2]
  double position_rms = 0.0;                             ///< of positions about those of the IMU, per axis [m]
  double velocity_sigma = 0.0;  ///< standard deviation of the first velocity, largest direction [m/s]
  double gravity_sigma = 0.0;   ///< of the direction of gravity, likewise [rad]
  bool solvable = false;
};

/// Positions c + v_0 t + g t^2 / 2 + D(t), D from the IMU, fitted to those of the poses: linearly with free g, then
/// with g of known length (two angles about the one before; as Qin, Li and Shen, section V.B.3) and a bias of the
/// accelerometer near 0: without turns, only its part along gravity can be told. What an IMU errs beyond that in
/// seconds is far below what positions err, so that it counts as exact.
InertialAlignment alignPositions(const std::vector<StereoOdometry::Pose>& poses,
                                 const std::vector<ImuPreintegration>& integrals, double gravity);

/// Rotation into a frame with z up, in which `forward` has no part along y.
/// @param up,forward  not parallel.
Eigen::Quaterniond levelRotation(const Eigen::Vector3d& up, const Eigen::Vector3d& forward);

}  // namespace pi_slam
