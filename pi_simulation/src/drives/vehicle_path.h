#pragma once

#include "world/path_shape.h"

#include <pi_slam/trajectory_file.h>

#include <cstdint>
#include <string>
#include <vector>

namespace pi_simulation
{

/// @throws std::invalid_argument that lists the known names: campus_loop, hall_loop, straight, figure_eight.
PathShape parsePathShape(const std::string& name);

struct VehiclePathOptions
{
  PathShape shape = PathShape::CAMPUS_LOOP;
  double duration_s = 20.0;         ///< of the whole drive, standstills included; in [1, 86400]
  int rounds = 0;                   ///< of a closed shape, instead of duration_s; ends at the start. 0: none
  double speed = 3.0;               ///< on straights [m/s]; curves are driven with at most 1.2 m/s^2 to the side
  double start_standstill_s = 2.0;  ///< at the start; 0: sets off at once
  double end_standstill_s = 0.0;    ///< at the end, after the vehicle came to rest
  int stops = 0;                    ///< spread evenly over the way
  double stop_s = 3.0;              ///< length of each stop
  double bumps = 1.0;               ///< scale of the road's unevenness; 0: flat. 1: 15 mm, 0.4 degrees
  double height_m = 1.0;            ///< of the body above the ground, z = 0
  int64_t start_ns = 1700000000000000000LL;
  uint64_t seed = 1;  ///< of the bumps

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// Poses at 50 Hz of a vehicle that follows the shape, round after round where it is closed: body x forward, y left,
/// z up, accelerations within 1 m/s^2 along the way, pitch, roll and height from bumps fixed to the road.
std::vector<pi_slam::StampedPose> makeVehiclePath(const VehiclePathOptions& options);

}  // namespace pi_simulation
