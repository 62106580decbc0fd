#pragma once

#include <pi_slam/stereo_calibration.h>
#include "front_end/frame_features.h"
#include "front_end/motion_check.h"
#include "front_end/stereo_geometry.h"
#include "inertial/imu_preintegration.h"
#include "initialization/rest_statistics.h"

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <optional>
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

/// Distinguishes standstill from slow motion: neither pictures nor IMU may see motion over a window. Without pictures
/// the answer is no, since an IMU alone cannot tell standstill from constant velocity.
///
/// Features are compared with where they were a window ago, and four windows ago (with twice the bound), so that the
/// verdict does not depend on the rate of pictures: 0.05 m/s is 0.1 px per pair at 60 Hz. Deviations of the IMU are
/// those of its means over eighths of the window: a motor that shakes faster does not count. What stands still is
/// taken to do so until one of the bounds is passed by half.
///
/// Creeping passes all that. So what both cameras see also gives the way since the pair at which the rest began, and,
/// before it may begin, since four windows ago: more than CREPT_M and CREEPING_M is no rest.
///
/// Where wheels tell, they decide together with the IMU: people who fill the picture are no motion then, and a creep is
/// one at once. Where they do not, the IMU decides, by what it showed at rest before (RestStatistics): if pictures
/// show, after a rest, a speed that no vehicle has at once, or if some of the features have not moved while most have.
///
/// Not thread safe.
class StandstillDetector
{
public:
  static constexpr double CREPT_M = 0.01;      ///< way of a rest, after which it ends; half of what may be lost
  static constexpr double CREEPING_M = 0.005;  ///< way in four windows with which a rest does not begin

  /// @throws std::invalid_argument for a model or options out of range.
  StandstillDetector(const StereoCalibration& calibration, const ImuModel& model, const StandstillOptions& options);
  StandstillDetector(const StandstillDetector&) = delete;  // motion_check_ refers to geometry_
  StandstillDetector& operator=(const StandstillDetector&) = delete;

  /// @param features  of each pair, in order of time; another order, or a second without pairs, starts again.
  /// @param imu       covers the window before the pair; if not, the answer is no.
  /// @param at_rest   by the wheels over the window; nullopt: they do not tell. Then the pictures decide as without.
  /// @param speed_mps as estimated [m/s].
  /// @return true if the body has stood still over the window that ends at the stamp of `features`.
  bool update(const FrameFeatures& features, const ImuBuffer& imu, const ImuBias& bias,
              std::optional<bool> at_rest = std::nullopt, double speed_mps = 0.0);

  /// Since when, if the last update() returned true [ns].
  int64_t sinceNs() const { return since_ns_; }

  /// Median distance that features went within the window at the last update() [px]; negative: not known.
  double flowPx() const { return flow_px_; }

  /// Whether the IMU, and wheels if they tell, said rest at the last update(), and pictures motion.
  bool pictureMoves() const { return picture_moves_; }

  /// Whether the last update() ended a rest of which the last window knows nothing: the body has moved for longer.
  bool crept() const { return crept_; }

  void reset();

private:
  bool isCalm(const ImuWindow& window, const ImuBias& bias, double slack) const;
  const FrameFeatures* movedSince(const FrameFeatures* reference, const FrameFeatures& features, double slack);
  bool disputed(const FrameFeatures& pair, const FrameFeatures& features);
  bool hasStayed(const FeatureObservation& was, const FeatureObservation& is) const;
  FrameFeatures unmovedOf(const FrameFeatures& pair, const FrameFeatures& features) const;
  double flowSince(const FrameFeatures& pair, const FrameFeatures& features);
  std::optional<double> wayBetween(const FrameFeatures& pair, const FrameFeatures& features);
  const FrameFeatures* pairBefore(int64_t stamp_ns) const;

  const ImuModel model_;
  const StandstillOptions options_;
  const front_end::StereoGeometry geometry_;
  front_end::MotionCheck motion_check_;
  std::deque<FrameFeatures> pairs_;  ///< of the last four windows, about eight of each, oldest first
  FrameFeatures first_;              ///< the pair at which the rest began
  std::vector<float> distances_;     ///< kept to allocate once, as are the next two
  std::vector<front_end::MovedFeature> moved_;
  std::vector<uint8_t> consistent_;
  RestStatistics rest_;
  int64_t last_ns_ = 0;
  int64_t since_ns_ = 0;
  int64_t imu_moved_ns_ = 0;  ///< last it ended a rest
  double flow_px_ = -1.0;
  bool still_ = false;
  bool crept_ = false;
  bool picture_moves_ = false;
};

}  // namespace pi_slam
