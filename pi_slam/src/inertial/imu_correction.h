#pragma once

#include <pi_slam/imu_sample.h>

#include <Eigen/Core>
#include <cmath>

namespace pi_slam
{

/// What turns a sample of the IMU into one as the cameras' clock and mounting want it.
struct ImuCorrection
{
  double late_s = 0.0;                                       ///< of the cameras' stamps: samples get it added [s]
  Eigen::Matrix3d R_body_imu = Eigen::Matrix3d::Identity();  ///< beyond the calibration

  ImuSample operator()(ImuSample sample) const
  {
    sample.stamp_ns += std::llround(1e9 * late_s);
    sample.w = R_body_imu * sample.w;
    sample.f = R_body_imu * sample.f;
    return sample;
  }
  /// First `before`, then this one.
  ImuCorrection after(const ImuCorrection& before) const
  {
    return {late_s + before.late_s, R_body_imu * before.R_body_imu};
  }
};

}  // namespace pi_slam
