#pragma once

#include "estimator/simulated_features.h"

#include <pi_slam/imu_sample.h>
#include <pi_slam/spline_trajectory.h>
#include "estimator/window_estimator.h"
#include "inertial/nav_state.h"

#include <cstdint>
#include <vector>

struct ConsistencyOptions
{
  double duration_s = 30.0;
  double pair_interval_s = 0.05;
  int pairs_per_keyframe = 4;
  double pixel_noise = 1.0;  ///< simulated, and told to the estimator [px]
  double readout_s = 0.0;    ///< of simulated rolling shutters [s]
  bool straighten = false;   ///< what they see
  pi_slam::StereoCalibration calibration = pi_slam::StereoCalibration::makeForwardPair(752, 480, 0.11);
  pi_slam::WindowOptions window;
};

/// How far the estimate was off, and how far it said that it might be.
struct ConsistencySample
{
  double time_s = 0.0;
  bool keyframe = false;   ///< after optimisation; else after the filter's update
  double nees_pose = 0.0;  ///< normalised squared error of position and orientation, 6 degrees of freedom
  double nees_position = 0.0;
  double nees_rotation = 0.0;
  double nees_heading = 0.0;  ///< 1 degree of freedom
  double nees_state = 0.0;    ///< 15 degrees of freedom
  double position_error_m = 0.0;
  double rotation_error_rad = 0.0;
};

/// A drive in eights with pitching and rolling, for any time.
pi_slam::SplineTrajectory consistencyTrajectory(double duration_s);

/// One run of filter and window on a simulated drive: the initial state is drawn from the covariance that the estimator
/// is told. Everything follows from the seed.
std::vector<ConsistencySample> runConsistency(const pi_slam::SplineTrajectory& trajectory,
                                              const ConsistencyOptions& options, uint64_t seed);
