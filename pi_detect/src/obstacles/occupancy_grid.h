#pragma once

#include <pi_detect/outline.h>
#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace pi_detect
{

struct OccupancyGridOptions
{
  double cell_m = 0.1;       ///< side of a cell [m]
  double size_m = 40.0;      ///< side of the grid, whose middle is the vehicle [m]
  double memory_s = 30.0;    ///< time constant with which cells become unknown that are not seen any more [s]
  double max_sigma_m = 0.4;  ///< of a distance that counts [m]
  double rate_hz = 5.0;      ///< at which it is published [Hz]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// What the cells around the vehicle hold, in odom: free, occupied or unknown, as seen. A cell keeps log odds
/// (Moravec and Elfes 1985): each view adds to them, more the better it measures, at most once per cell. It moves with
/// the vehicle in whole cells. What was seen far away is not kept. Not thread safe.
class OccupancyGrid
{
public:
  explicit OccupancyGrid(const OccupancyGridOptions& options = OccupancyGridOptions());

  /// Takes a view. @param T_odom_base  at its stamp; roll and pitch do not count.
  /// @param left_out  outlines in base_link of what will not stay: nothing in them becomes occupied [m].
  /// @param vehicle  its outline in base_link: where it stands is free.
  void add(int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base, const GroundView& view,
           const std::vector<Outline>& left_out, const Outline& vehicle);
  void clear();

  int side() const { return side_; }                   ///< cells per row and column
  double cellSize() const { return options_.cell_m; }  ///< [m]
  Eigen::Vector2d origin() const;                      ///< corner of the cell (0, 0), in odom [m]
  int64_t stampNs() const { return stamp_ns_; }        ///< of the newest view; 0: none
  /// Row by row from the origin: 0 (free) to 100 (occupied) percent, -1 unknown; as nav_msgs/OccupancyGrid.
  std::vector<int8_t> cells() const;

private:
  using Index = Eigen::Array2i;  ///< of a cell in odom; a cell is stored at its index modulo the side

  float& at(const Index& cell);
  Index indexOf(const Eigen::Vector2d& p_odom) const;
  void moveTo(const Index& middle);
  void clearLines(int axis, int from, int to);
  void fade(int64_t stamp_ns);
  /// @param least  negative: a free view makes the cell no surer than this.
  void change(const Index& cell, float by, float least);
  void fill(const Outline& outline_odom, float by);

  const OccupancyGridOptions options_;
  const int side_;
  std::vector<float> log_odds_;
  std::vector<uint32_t> changed_;  ///< number of the view that changed the cell last
  uint32_t view_ = 0;
  Index low_ = Index::Zero();  ///< lowest index of a cell that is kept
  bool placed_ = false;
  Eigen::Vector2d p_odom_last_ = Eigen::Vector2d::Zero();
  int64_t stamp_ns_ = 0;
  int fade_row_ = 0;
};

}  // namespace pi_detect
