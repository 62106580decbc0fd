#pragma once

#include <pi_detect/outline.h>

#include <Eigen/Core>
#include <vector>

#include "obstacles/surface_point.h"

namespace pi_detect::obstacles
{

/// How well one camera sees, for outlines.
struct OutlineScale
{
  Eigen::Vector2d camera = Eigen::Vector2d::Zero();  ///< its place on the ground, in the frame of the points [m]
  double cell_rad = 0.0;                             ///< width of a cell, as an angle [rad]
  double fb = 1.0;                                   ///< fx * baseline of the disparity picture [px m]
};

/// The convex hull of what the points see, on the ground: half a cell wider at the sides, and nearer and farther by the
/// depth's error that does not average out. A point that hardly any other one lies near to is left out; these are few,
/// or none is left out. At most MAX_OUTLINE_CORNERS corners, never thinner than 0.1 m. Points of one column of cells
/// are taken to lie on one ray on the ground, as they do for cameras that are not rolled by more than some degrees.
/// @param part  not empty.
Outline measureOutline(const std::vector<SurfacePoint>& part, const OutlineScale& scale);

}  // namespace pi_detect::obstacles
