#pragma once

#include <pi_slam/stereo_calibration.h>
#include "front_end/frame_features.h"
#include "front_end/motion_check.h"
#include "front_end/stereo_geometry.h"
#include "inertial/imu_correction.h"
#include "inertial/imu_preintegration.h"
#include "odometry/force_calibrator.h"

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

namespace pi_slam
{

/// What is known of the cameras against the IMU.
struct RigReport
{
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  ///< of the cameras, beyond the calibration, body frame [rad]
  double late_s = 0.0;                             ///< the cameras' stamps, beyond the calibration [s]
  /// Of turn and late_s; at first 2 degrees and 15 ms.
  Eigen::Matrix4d covariance = Eigen::Vector4d(0.035, 0.035, 0.035, 0.015).cwiseAbs2().asDiagonal();
  Eigen::Vector3d gyro_scale = Eigen::Vector3d::Ones();  ///< what the gyroscope says over what is, per axis
  Eigen::Vector3d p_body_imu = Eigen::Vector3d::Zero();  ///< of the IMU, beyond the calibration [m]
  Eigen::Vector3d gyro_scale_deviation = Eigen::Vector3d::Constant(0.02);
  Eigen::Vector3d p_body_imu_deviation = Eigen::Vector3d::Constant(ForceCalibrator::FIRST_PLACE);  ///< [m]
  ImuCorrection used;  ///< taken over so far

  /// Standard deviation about each axis; large where the motion does not tell it [rad].
  Eigen::Vector3d turnDeviation() const { return covariance.diagonal().head<3>().cwiseSqrt(); }
  double lateDeviation() const { return std::sqrt(covariance(3, 3)); }  ///< [s]
};

/// Finds by how much the cameras' stamps are late, how far their mounting is turned, and the scale of the gyroscope:
/// all make the rotation between two pairs by pictures differ from the gyroscope's. A Kalman filter of ten numbers
/// (turn, lateness, bias and scale of the gyroscope) compares them every 0.2 s. It needs no estimate of pose or speed,
/// so it works before a start too. Its variances tell what the motion allows: without turns about two axes one angle of
/// the mounting and two scales stay unknown, and at constant rate the lateness. Only what is known well and matters is
/// taken over, of a turn the axes that are known. What the force tells is ForceCalibrator's.
///
/// Not thread safe.
class RigCalibrator
{
public:
  /// @param before  what another one found for the same calibration; samples have its correction already.
  RigCalibrator(const StereoCalibration& calibration, const ImuModel& model, const RigReport& before = RigReport());
  RigCalibrator(const RigCalibrator&) = delete;  // motion_check_ refers to geometry_
  RigCalibrator& operator=(const RigCalibrator&) = delete;

  /// @param features  of each pair in motion, in order of time. @param imu  corrected as far as known, covers the pair.
  void add(const FrameFeatures& features, const ImuBuffer& imu);

  /// A correction that is due, for samples that are corrected already; what add() gets from now on must have it.
  std::optional<ImuCorrection> take();

  RigReport report() const;

private:
  static constexpr int TURN = 0, LATE = 3, BIAS = 4, SCALE = 7;
  using Vector10d = Eigen::Matrix<double, 10, 1>;
  using Matrix10d = Eigen::Matrix<double, 10, 10>;

  bool compare(const FrameFeatures& features, const ImuBuffer& imu);

  const front_end::StereoGeometry geometry_;
  front_end::MotionCheck motion_check_;
  FrameFeatures reference_;
  std::vector<front_end::MovedFeature> moved_;
  std::vector<uint8_t> consistent_;
  Vector10d x_ = Vector10d::Zero();
  Matrix10d P_ = Matrix10d::Zero();
  double variance_;   ///< of a rotation by pictures [rad^2]
  int compared_ = 0;  ///< since the last correction
  ForceCalibrator force_;
  ImuCorrection used_;
};

}  // namespace pi_slam
