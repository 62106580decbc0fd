#pragma once

#include <pi_detect/obstacle_tracker.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "obstacles/occupancy_grid.h"
#include "truth.h"

namespace pi_detect::bench
{

/// The grid of a whole drive against all that was rendered. Nothing fades, as in the map that keeps it.
class GridScore
{
public:
  GridScore();

  /// @param obstacles  published: those that move are left out.
  void add(int64_t stamp_ns, const Eigen::Isometry3d& T_world_base, const StereoObstacles::Result& result,
           const std::vector<Obstacle>& obstacles, const TruthCloud& truth);
  void print() const;
  /// PNG: free white, occupied black, unknown grey; true cells that are missing red. Empty name: none.
  void draw(const std::string& file) const;

private:
  using Cell = std::pair<int, int>;

  Cell cellOf(const Eigen::Vector2d& p) const;
  static bool isNear(const std::set<Cell>& cells, const Cell& cell);
  std::set<Cell> occupied() const;

  OccupancyGrid grid_;
  std::set<Cell> raised_;   ///< everything above the ground that was in view
  std::set<Cell> passed_;   ///< of it, what stands, is an obstacle by its height, and came within PASSED_M
  std::set<Cell> moving_;   ///< where something moved
  std::vector<double> ms_;  ///< time of the processor per view
};

}  // namespace pi_detect::bench
