#pragma once

#include "inertial/imu_preintegration.h"
#include "inertial/nav_state.h"
#include "inertial/wheels.h"

#include <pi_slam/stereo_calibration.h>

#include <Eigen/Core>
#include <array>
#include <optional>

namespace pi_slam::estimator
{

/// What the factors need of a camera.
struct CameraGeometry
{
  Eigen::Matrix3d R_camera_body = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_camera_body = Eigen::Vector3d::Zero();  ///< of the body's origin in the camera frame [m]
  double focal_px = 1.0;                                    ///< pixels per radian at the middle of the picture
  CameraModel model;
};
std::array<CameraGeometry, 2> cameraGeometry(const StereoCalibration& calibration);

/// Two rows that take a vector to the plane tangent to the unit sphere at `bearing`.
Eigen::Matrix<double, 2, 3> tangentBasis(const Eigen::Vector3d& bearing);

/// The same rows times pixels per radian as the lens has them in that direction: errors are those of the raw picture
/// [px].
Eigen::Matrix<double, 2, 3> viewTangent(const CameraGeometry& camera, const Eigen::Vector3d& bearing);

/// Error of a landmark in the body frame: the direction to it, taken to the tangent plane of the bearing observed.
/// @param tangent      viewTangent() over the noise [1]
/// @param[out] J_body  by p_body; may be null
/// @return the error [standard deviations]. Landmarks behind the camera give an error of 1000 and no derivative.
Eigen::Vector2d viewError(const CameraGeometry& camera, const Eigen::Vector3d& bearing,
                          const Eigen::Matrix<double, 2, 3>& tangent, const Eigen::Vector3d& p_body,
                          Eigen::Matrix<double, 2, 3>* J_body);

/// Reprojection error of a landmark: the direction to it, taken to the tangent plane of the bearing observed.
/// @param R_odom_body, p_odom_body  pose of the body
/// @param tangent      viewTangent() over the noise [1]
/// @param[out] J_pose     by [d_p, d_theta] of the pose; may be null
/// @param[out] J_landmark by p_landmark; may be null
/// @return the error [standard deviations]. Landmarks behind the camera give an error of 1000 and no derivative.
Eigen::Vector2d reprojectionError(const Eigen::Matrix3d& R_odom_body, const Eigen::Vector3d& p_odom_body,
                                  const CameraGeometry& camera, const Eigen::Vector3d& bearing,
                                  const Eigen::Matrix<double, 2, 3>& tangent, const Eigen::Vector3d& p_landmark,
                                  Eigen::Matrix<double, 2, 6>* J_pose, Eigen::Matrix<double, 2, 3>* J_landmark);

/// The way of the wheels between two states, as the window needs it.
struct WheelTie
{
  /// @param way  valid.
  WheelTie(const WheelWay& way, const WheelOptions& options, const WheelScale& scale);

  /// Forward, left and up in the wheels' frame at `begin`, whitened.
  /// @param[out] J  by the errors of `begin` (columns 0..14) and of `end` (15..29)
  Eigen::Vector3d error(const NavState& begin, const NavState& end, Eigen::Matrix<double, 3, 30>* J) const;

  Eigen::Vector3d moved;   ///< of the wheels' frame, in the body frame at the beginning [m]
  Eigen::Vector3d lever;   ///< of the wheels' origin in the body frame [m]
  Eigen::Matrix3d weight;  ///< takes an error in the body frame to the wheels' frame, over deviations
};

/// The link between two neighbouring states: preintegrated IMU, or standstill; and the way of the wheels, if known.
class StateLink
{
public:
  /// @param gravity  [m/s^2]
  StateLink(const ImuPreintegration& imu, const ImuModel& model, bool still);

  /// Error of the two states, whitened: 15 rows in the order of NavState (Forster et al. 2017, eq. 45).
  /// @param[out] J  by the errors of `begin` (columns 0..14) and of `end` (15..29); may be null
  Vector15d error(const NavState& begin, const NavState& end, Eigen::Matrix<double, 15, 30>* J) const;

  /// Integrates again if the bias is far from the one of the integral.
  void relinearize(const ImuBias& bias);

  bool still() const { return still_; }
  std::optional<WheelTie> wheels;
  const ImuPreintegration& imu() const { return imu_; }

private:
  void updateWeight();

  ImuPreintegration imu_;
  ImuModel model_;
  bool still_;
  Matrix15d sqrt_information_;  ///< lower triangular
};

}  // namespace pi_slam::estimator
