#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace pi_vehicle
{

/// A grid on the ground as nav_msgs/OccupancyGrid has it, placed in the map.
struct GroundGrid
{
  static constexpr int OCCUPIED = 65;  ///< percent, from here on
  static constexpr int FREE = 35;      ///< down from here

  int64_t stamp_ns = 0;
  Pose2 T_map_grid;  ///< corner of the first cell, direction of the rows
  double cell_m = 0.1;
  int width = 0;
  int height = 0;
  std::shared_ptr<const std::vector<int8_t>> cells;  ///< row by row: 0 to 100, -1 unknown; width * height

  /// @return percent, or -1: unknown, or outside.
  int at(const Eigen::Vector2d& p_map) const
  {
    const Eigen::Vector2d p = T_map_grid.inverse() * p_map / cell_m;
    if (!(p.x() >= 0.0 && p.y() >= 0.0 && p.x() < width && p.y() < height))
    {
      return -1;
    }
    return (*cells)[static_cast<size_t>(p.y()) * static_cast<size_t>(width) + static_cast<size_t>(p.x())];
  }
};

/// The shortest way over a grid that keeps `radius` away from what is occupied (A*, Hart et al. 1968), as corners
/// between which the straight line does, too. Unknown ground counts as three times as long. Beside the start, where the
/// vehicle stands already, nothing is kept away from.
/// @return corners after the start, the last one the goal; nullopt: there is none, or an end is not on the grid.
std::optional<std::vector<Eigen::Vector2d>> findWay(const GroundGrid& grid, const Eigen::Vector2d& from,
                                                    const Eigen::Vector2d& to, double radius);

}  // namespace pi_vehicle
