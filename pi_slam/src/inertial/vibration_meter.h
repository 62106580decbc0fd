#pragma once

#include <pi_slam/imu_sample.h>

#include <Eigen/Core>
#include <optional>
#include <string>

namespace pi_slam
{

/// Measures how much the IMU shakes beyond its own noise, and says so in each sample: a motor, gravel, potholes.
///
/// No vehicle moves fast enough for the second difference of neighbouring samples to show it, so what is there is noise
/// or vibration. Of a vibration nobody knows which part folds down into the band of the motion (33 Hz with harmonics at
/// 200 Hz: the sixth comes out at 2 Hz). So it counts as white noise of the same power: pictures and wheels decide
/// then. Not thread safe.
class VibrationMeter
{
public:
  explicit VibrationMeter(const ImuModel& model);

  /// @param[in,out] sample  in order of time; gets f_shake.
  void add(ImuSample* sample);

  /// RMS of the axis that shakes most [m/s^2]; 0: not beyond the sensor's noise.
  double acceleration() const { return acceleration_; }

  /// What is to be said of it: object, value, way out; empty: nothing.
  std::string message() const;

private:
  const ImuModel model_;
  std::optional<ImuSample> last_[2];  ///< the newest first
  Eigen::Vector3d power_ = Eigen::Vector3d::Zero();
  double acceleration_ = 0.0;
};

}  // namespace pi_slam
