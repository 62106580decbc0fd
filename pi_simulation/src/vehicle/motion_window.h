#pragma once

#include <pi_slam/imu_sample.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>

namespace pi_simulation
{

/// The last poses of the vehicle, one every PERIOD_NS, and what follows from them by central differences over
/// +-REACH periods. A sample of the IMU every REACH periods then adds up to the true change of velocity: that is the
/// sensor's low-pass filter. Not thread safe.
class MotionWindow
{
public:
  static constexpr int64_t PERIOD_NS = 1'000'000;
  static constexpr int REACH = 5;  ///< periods

  /// @param stamp_ns  one period after the one before; else the window begins anew.
  void add(int64_t stamp_ns, const Eigen::Isometry3d& T_world_base);
  void clear() { poses_.clear(); }

  /// True if there are enough poses around stampNs().
  bool ready() const { return poses_.size() == 2 * REACH + 1; }
  /// The middle of the window, to which all below belongs; only if ready().
  int64_t stampNs() const { return stamp_ns_ - REACH * PERIOD_NS; }
  const Eigen::Isometry3d& pose() const { return poses_[REACH]; }
  /// Velocity and angular rate of base_link, along its own axes [m/s, rad/s].
  Eigen::Vector3d velocity() const;
  Eigen::Vector3d angularRate() const;
  /// What an ideal IMU measures: its angular rate and specific force, along its axes.
  /// @param gravity  [m/s^2], along -z of the world.
  pi_slam::ImuSample imu(const Eigen::Isometry3d& T_base_imu, double gravity) const;

private:
  std::deque<Eigen::Isometry3d> poses_;
  int64_t stamp_ns_ = 0;  ///< of the last one
};

}  // namespace pi_simulation
