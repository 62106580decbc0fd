#pragma once

#include "inertial/imu_preintegration.h"

#include <Eigen/Core>
#include <cstdint>
#include <optional>

namespace pi_slam
{

/// What an IMU shows over a window.
struct ImuWindow
{
  int64_t end_ns = 0;
  Eigen::Vector3d w = Eigen::Vector3d::Zero();  ///< mean, with its bias [rad/s]
  Eigen::Vector3d f = Eigen::Vector3d::Zero();  ///< mean [m/s^2]
  double w_deviation = 0.0;                     ///< of the means over eighths of the window, largest axis [rad/s]
  double f_deviation = 0.0;                     ///< likewise [m/s^2]
  double w_noise = 0.0;                         ///< what the sensor's noise alone gives there [rad/s]
  double f_noise = 0.0;                         ///< [m/s^2]
};

/// A motor that shakes faster than an eighth of the window does not count.
/// @return nullopt if the samples do not cover the window.
std::optional<ImuWindow> measureWindow(const ImuBuffer& imu, const ImuModel& model, int64_t end_ns, double length_s);

/// What the IMU shows while this vehicle stands, learned from the rests that pictures confirm. With it the IMU alone
/// tells that a rest goes on: who drives off has to accelerate. That holds for seconds after the last confirmation, not
/// for ever: an acceleration below some mm/s^2 is not seen.
/// Not thread safe.
class RestStatistics
{
public:
  /// Baseline of rate and force begin anew: another place has another tilt.
  void beginRest() { baseline_s_ = 0.0; }

  /// A window at rest. @param confirmed  by pictures; if not, only the baseline follows, slowly.
  void learn(const ImuWindow& window, bool confirmed);

  /// Shakes no more than at rest.
  bool quiet(const ImuWindow& window) const;
  /// Is quiet, turns no faster than at rest, and has gained no speed since pictures last confirmed the rest.
  bool unmoved(const ImuWindow& window) const;

private:
  int64_t last_ns_ = 0;
  double known_s_ = 0.0;     ///< of confirmed rests
  double baseline_s_ = 0.0;  ///< of this rest
  double w_level_ = 0.0;     ///< mean square of deviations
  double f_level_ = 0.0;
  Eigen::Vector3d w_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d gained_ = Eigen::Vector3d::Zero();  ///< speed, which fades [m/s]
};

}  // namespace pi_slam
