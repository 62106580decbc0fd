#pragma once

#include "front_end/frame_features.h"
#include "inertial/imu_preintegration.h"
#include "inertial/nav_state.h"
#include <pi_slam/stereo_calibration.h>

#include <memory>
#include <string>
#include <vector>

namespace pi_slam
{

struct InitializerOptions
{
  double interval_s = 0.1;       ///< between the pairs that are used; in [0.02, 1]
  double still_window_s = 0.5;   ///< pairs collected before a start from standstill; in [0.2, 5]
  double moving_window_s = 0.7;  ///< pairs collected before a start while moving; in [0.5, 5]
  double max_window_s = 3.0;  ///< older pairs are forgotten; two intervals above the other windows at least, up to 10
  int min_features = 20;      ///< seen by both cameras and placed by stereo, in every pair; in [8, 1000]
  double gravity_tolerance = 0.05;  ///< largest relative error of the gravity found while moving; in (0, 0.5]
  double max_accel_bias = 1.5;      ///< [m/s^2]; > 0
  double max_gyro_bias = 0.5;       ///< [rad/s]; > 0

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// Where to begin: states that agree with pictures and IMU well enough for the window to take them over.
struct InitialSolution
{
  std::vector<NavState> states;       ///< of the pairs used, oldest first. odom: z up, origin and heading (yaw 0 along
                                      ///< the body's horizontal direction of view) of the first
  std::vector<FrameFeatures> frames;  ///< what they saw
  bool still = false;                 ///< found at rest
};

/// Finds gravity, velocities and gyro bias at the start, at rest or in motion, without any of them known before:
/// stereo odometry over the pairs (landmarks triangulated by the pair, poses by robust resection and refinement), gyro
/// bias from the rotations (Qin, Li and Shen, VINS-Mono, TRO 2018, section V), then velocities, gravity and its
/// refinement to known length linearly from positions and preintegrated IMU; scale is known from stereo. Of the
/// accelerometer's bias only the part along gravity can be told in short windows: the rest stays near 0, and tilts the
/// gravity found by 0.6 degrees for 0.1 m/s^2.
///
/// One attempt takes 15 to 30 ms for 11 pairs with 150 features, and uses at most 20 pairs.
/// Deterministic. Not thread safe.
class Initializer
{
public:
  /// @throws std::invalid_argument for options, a model or a calibration out of range.
  Initializer(const StereoCalibration& calibration, const ImuModel& model, const InitializerOptions& options);
  ~Initializer();

  enum class Outcome
  {
    COLLECTING,  ///< not enough pairs yet
    FEW_FEATURES,
    NO_IMU,          ///< the IMU's samples do not cover the pairs
    NOT_CONSISTENT,  ///< pictures and IMU do not agree; message() says how far
    DONE,
  };
  /// @param imu       holds the samples since the oldest pair added (at least max_window_s).
  /// @param solution  written for DONE only, not null. Call reset() before a pair is added after that.
  Outcome add(const FrameFeatures& features, const ImuBuffer& imu, InitialSolution* solution);

  /// One sentence about the last outcome that was neither COLLECTING nor DONE: object, value, bound.
  const std::string& message() const;

  /// Begins anew, with nothing known.
  void reset();

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_slam
