#pragma once

#include <pi_slam/imu_sample.h>
#include "inertial/imu_correction.h"
#include "inertial/nav_state.h"
#include "inertial/wheels.h"

#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>

namespace pi_slam
{

/// A pose of the body at one time, as it goes out.
struct PropagatedState
{
  NavState state;
  Eigen::Vector3d w_body = Eigen::Vector3d::Zero();  ///< angular rate without bias, body frame [rad/s]
  Matrix15d covariance = Matrix15d::Zero();          ///< in the order of NavState
};

/// A pose per IMU sample, from the newest corrected state: the "IMU propagation" of the paper (section VII). Nothing
/// here waits for pictures: the lock is held for the integration of one sample, or, in rebase(), for that of the
/// samples since the corrected state.
///
/// Thread safe: samples from one thread, corrected states from another.
class ImuPropagator
{
public:
  /// @throws std::invalid_argument for a model out of range.
  explicit ImuPropagator(const ImuModel& model);

  /// @return the pose at the sample's stamp; nullopt before the first rebase(), after reset(), and for samples that are
  ///         not finite (or above 1e6), not after the last one, or before a corrected state that is newer than them. A
  ///         gap (as ImuBuffer's) is bridged by the mean of the samples around it; standard deviations of the sensor
  ///         count ten times meanwhile, and 300 times beside axes at the sensor's limit, which hold their last value.
  std::optional<PropagatedState> add(const ImuSample& sample);

  /// Continues from a corrected state: samples after its stamp are integrated again. A state that is older than the
  /// samples kept (5 s), or not finite, is refused; the propagation continues from the state before.
  /// @return false if refused.
  bool rebase(const NavState& state, const Matrix15d& covariance);

  /// Without a corrected state for a quarter of a second, the wheels keep the speed. Any thread.
  void addWheels(const WheelSample& sample);
  /// @param scale  nullopt: the wheels are not to be used, as at first.
  void setWheels(const WheelOptions& options, const std::optional<WheelScale>& scale);

  /// Corrects the samples that are kept; the poses follow with the next rebase().
  void correct(const ImuCorrection& correction);

  /// No more poses until the next rebase(). Samples are kept.
  void reset();

  /// The newest pose; nullopt as with add().
  std::optional<PropagatedState> newest() const;

private:
  void advance(const ImuSample& from, const ImuSample& to, PropagatedState* now) const;

  const ImuModel model_;
  const double longest_interval_s_;
  mutable std::mutex mutex_;
  std::deque<ImuSample> samples_;
  WheelOptions wheels_;
  std::optional<WheelScale> scale_;
  int64_t rebased_ns_ = 0;
  bool running_ = false;
  PropagatedState now_;
};

}  // namespace pi_slam
