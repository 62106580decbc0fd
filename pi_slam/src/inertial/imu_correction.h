#pragma once

#include <pi_slam/imu_sample.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace pi_slam
{

/// What turns a sample of the IMU into one as the cameras' clock, mounting and lengths want it. The body is where the
/// cameras say; the IMU may lie beside it.
struct ImuCorrection
{
  double late_s = 0.0;                                       ///< of the cameras' stamps: samples get it added [s]
  Eigen::Matrix3d R_body_imu = Eigen::Matrix3d::Identity();  ///< beyond the calibration
  Eigen::Vector3d gyro_scale = Eigen::Vector3d::Ones();      ///< what the sensor says over what is, per axis
  Eigen::Vector3d accel_scale = Eigen::Vector3d::Ones();     ///< likewise; of the model alone
  Eigen::Vector3d p_body_imu = Eigen::Vector3d::Zero();      ///< of the IMU, beyond the calibration [m]

  /// The scales that the model states.
  static ImuCorrection of(const ImuModel& model)
  {
    ImuCorrection correction;
    correction.gyro_scale = Eigen::Map<const Eigen::Vector3d>(model.gyro_scale.data());
    correction.accel_scale = Eigen::Map<const Eigen::Vector3d>(model.accel_scale.data());
    return correction;
  }

  /// @param before  the sample before it, corrected; null: the first.
  ImuSample operator()(ImuSample sample, const ImuSample* before) const
  {
    sample.stamp_ns += std::llround(1e9 * late_s);
    sample.w = R_body_imu * sample.w.cwiseQuotient(gyro_scale);
    sample.f = R_body_imu * sample.f.cwiseQuotient(accel_scale);
    if (before != nullptr && before->stamp_ns < sample.stamp_ns && !p_body_imu.isZero())
    {
      const Eigen::Vector3d turned_faster =
          (sample.w - before->w) / (1e-9 * static_cast<double>(sample.stamp_ns - before->stamp_ns));
      sample.f -= turned_faster.cross(p_body_imu) + sample.w.cross(sample.w.cross(p_body_imu));
    }
    return sample;
  }

  /// All of a sequence, in place. @param samples  by time.
  template <typename Samples>
  void correct(Samples* samples) const
  {
    const ImuSample* before = nullptr;
    for (ImuSample& sample : *samples)
    {
      sample = (*this)(sample, before);
      before = &sample;
    }
  }

  /// First `before`, then this one, to first order in both.
  ImuCorrection after(const ImuCorrection& before) const
  {
    return {late_s + before.late_s, R_body_imu * before.R_body_imu, gyro_scale.cwiseProduct(before.gyro_scale),
            accel_scale.cwiseProduct(before.accel_scale), p_body_imu + R_body_imu * before.p_body_imu};
  }
};

}  // namespace pi_slam
