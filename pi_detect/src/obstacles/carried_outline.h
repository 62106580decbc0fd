#pragma once

#include <pi_detect/outline.h>

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "obstacles/obstacle_place.h"

namespace pi_detect::obstacles
{

/// The outline of an obstacle that is followed: from its estimated position, along the axes of odom, so that it goes
/// with the position and does not turn with the vehicle.
class CarriedOutline
{
public:
  /// Takes a measurement as it is. @param measured  in base_link; may be empty.
  void take(int64_t stamp_ns, const Outline& measured, const VehiclePlace& vehicle, const Eigen::Vector2d& position);

  /// Takes what a measurement has in common with the last one (by GROWTH_M more), and around it what was shown a short
  /// while ago: what is joined or left out in a single picture does not count.
  /// @param moved  of the position since then, without a motion of the obstacle [m].
  /// @param cut    the obstacle may go on where it is not seen: what was shown is kept for longer.
  void correct(int64_t stamp_ns, const Outline& measured, const VehiclePlace& vehicle, const Eigen::Vector2d& position,
               const Eigen::Vector2d& moved, bool cut);

  /// In base_link; empty if none was measured.
  Outline at(const Eigen::Vector2d& position, const VehiclePlace& vehicle) const;

  bool empty() const { return shown_.empty(); }

private:
  struct Seen
  {
    int64_t stamp_ns;
    Outline outline;
  };

  Outline measured_;  ///< the last measurement
  std::vector<Seen> seen_;
  Outline shown_;
};

}  // namespace pi_detect::obstacles
