#include "map/map_grid.h"

#include <gtest/gtest.h>

#include <cmath>

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;

/// Nodes every metre along x of odom, which stands in map turned by `heading` and moved by (10, 20).
MapData mapWithNodes(int count, double heading)
{
  MapData map;
  const Eigen::Rotation2Dd R(heading);
  for (int i = 0; i < count; ++i)
  {
    MapNode node;
    node.serial = static_cast<uint64_t>(i);
    node.travelled_m = i;
    node.T_odom_body.translation() = Eigen::Vector3d(i, 0.0, 1.0);
    node.heading = heading;
    node.p_map_body << Eigen::Vector2d(10.0, 20.0) + R * Eigen::Vector2d(i, 0.0), 1.0;
    map.nodes.push_back(node);
  }
  return map;
}

/// 2 m x 2 m around a place in odom, of one value.
GridPatch patchAt(double x, double y, int8_t value, double travelled_m)
{
  GridPatch patch;
  patch.travelled_m = travelled_m;
  patch.cells = OccupancyCells{{x - 1.0, y - 1.0}, 0.1, 20, 20, std::vector<int8_t>(400, value)};
  return patch;
}

int valueAt(const OccupancyCells& grid, double x, double y)
{
  const Eigen::Vector2d cell = (Eigen::Vector2d(x, y) - grid.origin) / grid.cell_m;
  return cell.x() < 0.0 || cell.y() < 0.0 || cell.x() >= grid.width || cell.y() >= grid.height
             ? -1
             : grid.cells[static_cast<size_t>(cell.y()) * static_cast<size_t>(grid.width) +
                          static_cast<size_t>(cell.x())];
}

TEST(MapGrid, APatchStandsInMapAsItsNodeDoes)
{
  MapData map = mapWithNodes(10, M_PI_2);
  addPatch(&map, patchAt(5.0, 3.0, 100, 5.0));
  const auto grid = composeGrid(map, nullptr);
  ASSERT_TRUE(grid);
  EXPECT_EQ(100, valueAt(*grid, 10.0 - 3.0, 20.0 + 5.0));
  EXPECT_EQ(100, valueAt(*grid, 10.0 - 3.9, 20.0 + 5.9));
  EXPECT_EQ(-1, valueAt(*grid, 10.0 - 4.2, 20.0 + 5.0));
  map.nodes[5].p_map_body.x() += 0.5;  // a correction of the map
  EXPECT_EQ(100, valueAt(*composeGrid(map, nullptr), 10.5 - 2.1, 20.0 + 5.0));
}

TEST(MapGrid, TurnedPatchesHaveNoHoles)
{
  MapData map = mapWithNodes(10, 0.3);
  addPatch(&map, patchAt(5.0, 0.0, 0, 5.0));
  const auto grid = composeGrid(map, nullptr);
  ASSERT_TRUE(grid);
  const Eigen::Rotation2Dd R(0.3);
  for (double x = 4.1; x < 5.9; x += 0.05)
  {
    for (double y = -0.9; y < 0.9; y += 0.05)
    {
      const Eigen::Vector2d p = Eigen::Vector2d(10.0, 20.0) + R * Eigen::Vector2d(x, y);
      ASSERT_EQ(0, valueAt(*grid, p.x(), p.y())) << x << " " << y;
    }
  }
}

TEST(MapGrid, TheLatestThatKnowsACellCounts)
{
  MapData map = mapWithNodes(20, 0.0);
  addPatch(&map, patchAt(5.0, 0.0, 100, 5.0));
  GridPatch later = patchAt(8.0, 0.0, -1, 8.0);
  OccupancyCells cells{{4.0, -1.0}, 0.1, 40, 20, std::vector<int8_t>(800, -1)};
  for (int row = 0; row < 20; ++row)
  {
    cells.cells[static_cast<size_t>(row * 40)] = 0;  // knows only x from 4.0 to 4.1
  }
  later.cells = cells;
  addPatch(&map, later);
  const auto grid = composeGrid(map, nullptr);
  ASSERT_TRUE(grid);
  EXPECT_EQ(0, valueAt(*grid, 14.05, 20.0));
  EXPECT_EQ(100, valueAt(*grid, 14.5, 20.0));
  const GridPatch newest = patchAt(5.0, 0.0, 30, 9.0);
  EXPECT_EQ(30, valueAt(*composeGrid(map, &newest), 14.5, 20.0));
}

TEST(MapGrid, APlaceSeenAgainReplacesWhatWasThere)
{
  MapData map = mapWithNodes(20, 0.0);
  addPatch(&map, patchAt(5.0, 0.0, 100, 5.0));
  addPatch(&map, patchAt(6.0, 0.0, 0, 6.0));
  EXPECT_EQ(1u, map.patches.size());
  addPatch(&map, patchAt(11.0, 0.0, 0, 11.0));
  EXPECT_EQ(2u, map.patches.size());
  MapNode back = map.nodes[11];  // the way back: the same place, looked at from the other side
  back.segment = 1;
  back.heading = M_PI;
  map.nodes.push_back(back);
  GridPatch other = patchAt(11.0, 0.0, 0, 11.0);
  other.segment = 1;
  addPatch(&map, other);
  EXPECT_EQ(3u, map.patches.size());
}

TEST(MapGrid, PatchesOfLostSegmentsAreLeftOut)
{
  MapData map = mapWithNodes(20, 0.0);
  GridPatch lost = patchAt(5.0, 0.0, 100, 5.0);
  lost.segment = 7;
  addPatch(&map, lost);
  EXPECT_TRUE(map.patches.empty());
  EXPECT_FALSE(composeGrid(map, &lost));
}

TEST(PackedCells, GivesBackEveryCellAndTakesLittle)
{
  OccupancyCells street{{-3.0, 4.5}, 0.1, 240, 230, {}};
  for (int y = 0; y < street.height; ++y)
  {
    for (int x = 0; x < street.width; ++x)
    {
      const bool on_road = std::abs(y - 115) < 40;
      const bool wall = std::abs(std::abs(y - 115) - 42) < 2;
      street.cells.push_back(static_cast<int8_t>(wall ? 60 + (7 * x) % 41 : on_road ? (x * y) % 3 : -1));
    }
  }
  const PackedCells packed(street);
  const OccupancyCells back = packed.unpack();
  EXPECT_EQ(street.cells, back.cells);
  EXPECT_EQ(street.origin, back.origin);
  EXPECT_EQ(street.width, back.width);
  EXPECT_EQ(street.height, back.height);
  EXPECT_EQ(street.cells.size(), packed.count());
  EXPECT_LT(packed.bytes(), street.cells.size() / 5);
  EXPECT_EQ(0u, PackedCells().count());
  EXPECT_TRUE(PackedCells().unpack().cells.empty());
}

TEST(MapGrid, CutsOutWhatThereIs)
{
  OccupancyCells grid{{0.0, 0.0}, 0.1, 100, 50, std::vector<int8_t>(5000, 0)};
  grid.cells[static_cast<size_t>(20 * 100 + 30)] = 100;
  const OccupancyCells cut = cutOut(grid, {3.0, 2.0}, 1.0);
  EXPECT_EQ(20, cut.width);
  EXPECT_EQ(20, cut.height);
  EXPECT_EQ(100, valueAt(cut, 3.05, 2.05));
  EXPECT_EQ(0, valueAt(cut, 3.15, 2.05));
  const OccupancyCells corner = cutOut(grid, {0.0, 5.0}, 1.0);
  EXPECT_EQ(10, corner.width);
  EXPECT_EQ(10, corner.height);
  EXPECT_TRUE(cutOut(grid, {50.0, 50.0}, 1.0).cells.empty());
}

}  // namespace
