#pragma once

#include <Eigen/Core>

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

}  // namespace pi_detect::obstacles
