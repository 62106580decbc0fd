#pragma once

#include <pi_detect/outline.h>

#include <Eigen/Core>
#include <vector>

namespace pi_detect::obstacles
{

/// A cell of a surface in base_link.
struct SurfacePoint
{
  Eigen::Vector3f position;
  int column = 0;  ///< of the cell
  int row = 0;
  int pixels = 0;
};

/// Resolution of a camera, for outlines.
struct OutlineScale
{
  Eigen::Vector2d camera = Eigen::Vector2d::Zero();  ///< its place on the ground, in the frame of the points [m]
  double cell_rad = 0.0;                             ///< width of a cell, as an angle [rad]
  double fb = 1.0;                                   ///< fx * baseline of the disparity picture [px m]
};

/// The convex hull of the points on the ground, wider by half a cell at the sides, and by the constant error of depth
/// towards and away from the camera. Isolated points are ignored, up to a few. The outline has at most
/// MAX_OUTLINE_CORNERS corners and is at least 0.1 m thick. Points of one column of cells count as one ray on the
/// ground, which holds for cameras rolled by a few degrees at most.
/// @param part  not empty.
Outline measureOutline(const std::vector<SurfacePoint>& part, const OutlineScale& scale);

}  // namespace pi_detect::obstacles
