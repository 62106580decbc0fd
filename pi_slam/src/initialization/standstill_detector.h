#pragma once

#include "front_end/frame_features.h"
#include "inertial/imu_preintegration.h"

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <vector>

namespace pi_slam
{

struct StandstillOptions
{
  bool enabled = true;
  double window_s = 0.4;              ///< in which nothing may move; in [0.1, 5]
  double max_flow_px = 0.35;          ///< median distance that features go within the window; in [0.05, 5]
  double max_gyro_deviation = 0.02;   ///< standard deviation per axis beyond the sensor's noise [rad/s]; > 0
  double max_accel_deviation = 0.15;  ///< likewise [m/s^2]; > 0
  double max_rate = 0.03;             ///< mean rate per axis without the estimated bias [rad/s]; > 0

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// Tells standing still from slow motion: neither pictures nor IMU may see any over a window. Without pictures it says
/// no, since an IMU alone cannot tell standstill from constant velocity.
///
/// Features are compared with where they were a window ago, and four windows ago (with twice the bound), so that the
/// verdict does not depend on the rate of pictures: 0.05 m/s is 0.1 px per pair at 60 Hz. Deviations of the IMU are
/// those of its means over eighths of the window: a motor that shakes faster does not count. What stands still is
/// taken to do so until one of the bounds is passed by half.
///
/// Not thread safe.
class StandstillDetector
{
public:
  /// @throws std::invalid_argument for a model or options out of range.
  StandstillDetector(const ImuModel& model, const StandstillOptions& options);

  /// @param features  of each pair, in order of time; another order, or a second without pairs, begins anew.
  /// @param imu       covers the window before the pair; if not, the answer is no.
  /// @return true if the body has stood still over the window that ends at the stamp of `features`.
  bool update(const FrameFeatures& features, const ImuBuffer& imu, const ImuBias& bias);

  /// Since when, if the last update() returned true [ns].
  int64_t sinceNs() const { return since_ns_; }

  /// Median distance that features went within the window at the last update() [px]; negative: not known.
  double flowPx() const { return flow_px_; }

  void reset();

private:
  struct Track
  {
    int64_t id;
    bool seen[2];
    Eigen::Vector2f pixel[2];
  };
  struct Pair
  {
    int64_t stamp_ns;
    std::vector<Track> tracks;
  };

  bool imuIsCalm(int64_t stamp_ns, const ImuBuffer& imu, const ImuBias& bias, double slack) const;
  double flowSince(const Pair& pair, const FrameFeatures& features);
  const Pair* pairBefore(int64_t stamp_ns) const;

  const ImuModel model_;
  const StandstillOptions options_;
  std::deque<Pair> pairs_;        ///< of the last four windows, about eight of each, oldest first
  std::vector<float> distances_;  ///< kept to allocate once
  int64_t last_ns_ = 0;
  int64_t since_ns_ = 0;
  double flow_px_ = -1.0;
  bool still_ = false;
};

}  // namespace pi_slam
