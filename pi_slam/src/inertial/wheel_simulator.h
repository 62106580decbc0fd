#pragma once

#include <pi_slam/spline_trajectory.h>
#include "inertial/wheels.h"

#include <cstdint>
#include <vector>

namespace pi_slam
{

struct WheelSimulatorOptions
{
  double rate_hz = 50.0;
  double scale = 1.02;  ///< of what is said to what is true
  double noise = 0.01;  ///< part of the speed, of each sample
  /// Spinning or locked wheels: they say `factor` times the speed.
  struct Slip
  {
    double from_s = 0.0;  ///< since the first sample
    double to_s = 0.0;
    double factor = 1.0;
  };
  std::vector<Slip> slips;
  uint64_t seed = 1;
};

/// The wheels of a vehicle along a trajectory, below its body's origin, as a chassis tells them.
std::vector<WheelSample> simulateWheels(const SplineTrajectory& trajectory, const WheelSimulatorOptions& options);

}  // namespace pi_slam
