#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace pi_slam
{

/// A grid on the ground, as nav_msgs/OccupancyGrid has it.
struct OccupancyCells
{
  Eigen::Vector2d origin = Eigen::Vector2d::Zero();  ///< corner of the first cell [m]
  double cell_m = 0.1;                               ///< side of a cell [m]
  int width = 0;                                     ///< cells along x
  int height = 0;                                    ///< along y
  std::vector<int8_t> cells;                         ///< row by row: 0 (free) to 100 (occupied), -1 unknown
};

}  // namespace pi_slam
