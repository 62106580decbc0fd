#pragma once

#include <pi_detect/outline.h>

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "obstacles/obstacle_place.h"

namespace pi_detect::obstacles
{

/// The outline of a tracked obstacle, relative to its estimated position and along the axes of odom: it moves with the
/// obstacle and does not turn with the vehicle.
class CarriedOutline
{
public:
  /// Replaces the outline by a measurement. @param measured  in base_link; may be empty.
  void take(int64_t stamp_ns, const Outline& measured, const VehiclePlace& vehicle, const Eigen::Vector2d& position);

  /// Takes the part of a measurement that the last one confirms (with a margin of GROWTH_M), and adds the outlines of a
  /// short while before, so that errors of a single picture do not count.
  /// @param moved  change of the estimated position that is no motion of the obstacle [m].
  /// @param cut    parts of the obstacle may be hidden: former outlines are kept for longer.
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
