#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>

namespace pi_simulation
{

/// The unevenness of the ground: height and tilt of the vehicle as smooth functions of the place. They are waves with
/// the lengths and amplitudes of bench/drives/vehicle_path.h, each in a direction of its own. Immutable: any thread may
/// use it.
class RoadSurface
{
public:
  /// @param scale  of the unevenness; 0: flat, 1: 15 mm, 0.4 degrees.
  RoadSurface(double scale, uint64_t seed);

  /// Pose of a vehicle on this ground, in the world. x, y [m], heading [rad]: of its reference point.
  Eigen::Isometry3d T_world_base(double x, double y, double heading) const;

private:
  struct Wave
  {
    double amplitude;   ///< [m] or [rad]
    Eigen::Vector2d k;  ///< [rad/m]
    double phase;       ///< [rad]
    double at(const Eigen::Vector2d& p) const;
  };
  std::array<Wave, 3> height_;
  std::array<Wave, 2> pitch_;
  std::array<Wave, 2> roll_;
};

}  // namespace pi_simulation
