#include "map/map_grid.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_slam::map
{

namespace
{

constexpr double SAME_PATCH_M = 2.5;        // between the nodes of two patches
constexpr double SAME_DIRECTION_RAD = 0.8;  // between the directions in which the vehicle looked

/// Where a patch stands in map.
struct Placed
{
  Placed(const PackedCells& patch, const MapNode& node)
    : cells(&patch), R_map_odom(node.heading), p_map_odom(node.T_map_odom().translation().head<2>())
  {
    const OccupancyCells& frame = patch.frame();
    for (const int x : {0, frame.width})
    {
      for (const int y : {0, frame.height})
      {
        bounds.extend(R_map_odom * (frame.origin + frame.cell_m * Eigen::Vector2d(x, y)) + p_map_odom);
      }
    }
  }

  const PackedCells* cells;
  Eigen::Rotation2Dd R_map_odom;
  Eigen::Vector2d p_map_odom;
  Eigen::AlignedBox2d bounds;  ///< in map
};

double directionOf(const MapNode& node)
{
  const Eigen::Isometry3d T = node.T_map_body();
  // The axis of the body that is nearest to level tells its direction.
  const Eigen::Vector3d axis =
      std::abs(T.linear()(2, 0)) < std::abs(T.linear()(2, 2)) ? T.linear().col(0) : T.linear().col(2);
  return std::atan2(axis.y(), axis.x());
}

void draw(const Placed& placed, OccupancyCells* grid)
{
  const auto from = ((placed.bounds.min() - grid->origin) / grid->cell_m).array().floor().max(0.0).cast<int>().eval();
  const auto to = ((placed.bounds.max() - grid->origin) / grid->cell_m).array().ceil().cast<int>().eval();
  const OccupancyCells cells = placed.cells->unpack();
  const Eigen::Rotation2Dd R_odom_map = placed.R_map_odom.inverse();
  const Eigen::Vector2d step = R_odom_map * Eigen::Vector2d(grid->cell_m, 0.0) / cells.cell_m;
  for (int y = from.y(); y < std::min(to.y(), grid->height); ++y)
  {
    const Eigen::Vector2d p_map = grid->origin + grid->cell_m * Eigen::Vector2d(from.x() + 0.5, y + 0.5);
    Eigen::Vector2d at = (R_odom_map * (p_map - placed.p_map_odom) - cells.origin) / cells.cell_m;
    int8_t* cell =
        &grid->cells[static_cast<size_t>(y) * static_cast<size_t>(grid->width) + static_cast<size_t>(from.x())];
    for (int x = from.x(); x < std::min(to.x(), grid->width); ++x, ++cell, at += step)
    {
      if (at.x() >= 0.0 && at.y() >= 0.0 && at.x() < cells.width && at.y() < cells.height)
      {
        const int8_t value =
            cells.cells[static_cast<size_t>(at.y()) * static_cast<size_t>(cells.width) + static_cast<size_t>(at.x())];
        *cell = value >= 0 ? value : *cell;
      }
    }
  }
}

}  // namespace

OccupancyCells cutOut(const OccupancyCells& grid, const Eigen::Vector2d& middle, double reach_m)
{
  const auto index = [&grid](double distance) { return static_cast<int>(std::floor(distance / grid.cell_m)); };
  const int x = std::clamp(index(middle.x() - reach_m - grid.origin.x()), 0, grid.width);
  const int y = std::clamp(index(middle.y() - reach_m - grid.origin.y()), 0, grid.height);
  OccupancyCells cut;
  cut.cell_m = grid.cell_m;
  cut.origin = grid.origin + grid.cell_m * Eigen::Vector2d(x, y);
  cut.width = std::clamp(index(middle.x() + reach_m - grid.origin.x()), x, grid.width) - x;
  cut.height = std::clamp(index(middle.y() + reach_m - grid.origin.y()), y, grid.height) - y;
  for (int row = y; row < y + cut.height; ++row)
  {
    const auto from = grid.cells.begin() + static_cast<ptrdiff_t>(row) * grid.width + x;
    cut.cells.insert(cut.cells.end(), from, from + cut.width);
  }
  return cut;
}

const MapNode* nodeOf(const MapData& map, const GridPatch& patch)
{
  const MapNode* nearest = nullptr;
  for (const MapNode& node : map.nodes)
  {
    if (node.segment == patch.segment && (nearest == nullptr || std::abs(node.travelled_m - patch.travelled_m) <
                                                                    std::abs(nearest->travelled_m - patch.travelled_m)))
    {
      nearest = &node;
    }
  }
  return nearest;
}

void addPatch(MapData* map, GridPatch patch)
{
  const MapNode* here = nodeOf(*map, patch);
  if (here == nullptr)
  {
    return;
  }
  const auto isSame = [&](const GridPatch& other)
  {
    const MapNode* there = nodeOf(*map, other);
    return there == nullptr ||
           ((there->p_map_body - here->p_map_body).norm() < SAME_PATCH_M &&
            std::abs(std::remainder(directionOf(*there) - directionOf(*here), 2.0 * M_PI)) < SAME_DIRECTION_RAD);
  };
  map->patches.erase(std::remove_if(map->patches.begin(), map->patches.end(), isSame), map->patches.end());
  map->patches.push_back(std::move(patch));
}

std::optional<OccupancyCells> composeGrid(const MapData& map, const GridPatch* newest)
{
  std::vector<Placed> all;
  const auto place = [&](const GridPatch& patch)
  {
    if (const MapNode* node = nodeOf(map, patch))
    {
      all.emplace_back(patch.cells, *node);
    }
  };
  for (const GridPatch& patch : map.patches)
  {
    place(patch);
  }
  if (newest != nullptr)
  {
    place(*newest);
  }
  if (all.empty())
  {
    return std::nullopt;
  }
  OccupancyCells grid;
  grid.cell_m = all.front().cells->frame().cell_m;
  Eigen::AlignedBox2d bounds;
  for (const Placed& placed : all)
  {
    bounds.extend(placed.bounds);
  }
  const Eigen::Array2d first = (bounds.min() / grid.cell_m).array().floor();
  const Eigen::Array2d size = (bounds.max() / grid.cell_m).array().ceil() - first;
  if (!(size.prod() <= static_cast<double>(MOST_CELLS)))
  {
    return std::nullopt;
  }
  grid.origin = grid.cell_m * first.matrix();
  grid.width = static_cast<int>(size.x());
  grid.height = static_cast<int>(size.y());
  grid.cells.assign(static_cast<size_t>(grid.width) * static_cast<size_t>(grid.height), -1);
  for (const Placed& placed : all)
  {
    draw(placed, &grid);
  }
  return grid;
}

}  // namespace pi_slam::map
