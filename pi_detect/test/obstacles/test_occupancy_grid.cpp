#include "obstacles/occupancy_grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace pi_detect
{
namespace
{

constexpr int64_t SECOND = 1'000'000'000;

/// A camera at the origin of base_link that looks along x over 90 degrees: free ground from 2 m up to a wall.
GroundView viewOfWall(double wall_m, double sigma_m = 0.05)
{
  GroundView view;
  view.beam_rad = 0.02;
  for (double bearing = 0.78; bearing > -0.78; bearing -= view.beam_rad)
  {
    GroundBeam beam;
    beam.bearing = static_cast<float>(bearing);
    const double distance = wall_m / std::cos(bearing);
    beam.free_from = 2.0F;
    beam.free_to = static_cast<float>(distance - sigma_m);
    beam.hits[beam.hit_count++] = {static_cast<float>(distance), static_cast<float>(sigma_m)};
    view.beams.push_back(beam);
  }
  return view;
}

Eigen::Isometry3d poseOf(double x, double y, double heading)
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  pose.translation() = Eigen::Vector3d(x, y, 0.0);
  return pose;
}

int valueAt(const OccupancyGrid& grid, double x, double y)
{
  const Eigen::Vector2d cell = (Eigen::Vector2d(x, y) - grid.origin()) / grid.cellSize();
  EXPECT_TRUE(cell.x() >= 0.0 && cell.x() < grid.side() && cell.y() >= 0.0 && cell.y() < grid.side());
  return grid.cells()[static_cast<size_t>(cell.y()) * static_cast<size_t>(grid.side()) + static_cast<size_t>(cell.x())];
}

TEST(OccupancyGrid, KnowsNothingBeforeTheFirstView)
{
  const OccupancyGrid grid;
  EXPECT_EQ(400, grid.side());
  for (const int8_t cell : grid.cells())
  {
    ASSERT_EQ(-1, cell);
  }
}

TEST(OccupancyGrid, TheGroundUpToTheWallIsFreeTheWallOccupiedAndTheRestUnknown)
{
  OccupancyGrid grid;
  for (int i = 1; i <= 5; ++i)
  {
    grid.add(i * SECOND / 10, poseOf(100.0, 50.0, M_PI_2), viewOfWall(8.0), {}, {});
  }
  EXPECT_LE(valueAt(grid, 100.0, 55.0), 20);
  EXPECT_LE(valueAt(grid, 103.0, 57.0), 35);
  EXPECT_GE(valueAt(grid, 100.0, 58.0), 80);
  EXPECT_GE(valueAt(grid, 105.0, 58.0), 80);
  EXPECT_EQ(-1, valueAt(grid, 100.0, 58.5)) << "behind the wall";
  EXPECT_EQ(-1, valueAt(grid, 100.0, 51.0)) << "nearer than the camera sees the ground";
  EXPECT_EQ(-1, valueAt(grid, 108.0, 51.0)) << "beside the view";
}

TEST(OccupancyGrid, CellsStayWhereTheyAreWhileTheVehicleDrives)
{
  OccupancyGrid grid;
  for (int i = 0; i < 50; ++i)
  {
    grid.add((i + 1) * SECOND / 10, poseOf(0.1 * i, 0.0, 0.0), viewOfWall(12.0 - 0.1 * i), {}, {});
  }
  EXPECT_GE(valueAt(grid, 12.0, 0.0), 95);
  EXPECT_LE(valueAt(grid, 11.5, 0.0), 35);
  EXPECT_LE(valueAt(grid, 4.0, 0.0), 10) << "was seen before the vehicle came near";
  EXPECT_NEAR(4.9 - 20.0, grid.origin().x(), 0.11);
}

TEST(OccupancyGrid, WhatIsTooSmallToBeSeenFromAfarIsOccupiedAfterSomeViewsFromNearby)
{
  OccupancyGrid grid;
  int64_t stamp = SECOND;
  for (int i = 0; i < 40; ++i)
  {
    grid.add(stamp += SECOND / 20, poseOf(0.0, 0.0, 0.0), viewOfWall(16.0), {}, {});
  }
  EXPECT_LE(valueAt(grid, 12.0, 0.0), 35);
  for (int i = 0; i < 8; ++i)
  {
    grid.add(stamp += SECOND / 20, poseOf(6.0, 0.0, 0.0), viewOfWall(6.0, 0.2), {}, {});
  }
  EXPECT_GE(valueAt(grid, 12.0, 0.0), 65);
}

TEST(OccupancyGrid, WhatLeavesTheGridIsForgottenAndItsPlaceIsUsedAgain)
{
  OccupancyGridOptions options;
  options.size_m = 20.0;
  OccupancyGrid grid(options);
  grid.add(SECOND, poseOf(0.0, 0.0, 0.0), viewOfWall(8.0), {}, {});
  int64_t stamp = SECOND;
  for (double x = 0.0; x <= 40.0; x += 1.0)
  {
    grid.add(stamp += SECOND / 10, poseOf(x, 0.0, 0.0), GroundView(), {}, {});
  }
  for (const int8_t cell : grid.cells())
  {
    ASSERT_EQ(-1, cell);
  }
}

TEST(OccupancyGrid, WhatMovesIsLeftOutAndWhatItLeftBecomesFree)
{
  OccupancyGrid grid;
  const Outline around = {{7.5, -10.0}, {8.5, -10.0}, {8.5, 10.0}, {7.5, 10.0}};
  grid.add(SECOND, poseOf(0.0, 0.0, 0.0), viewOfWall(8.0), {around}, {});
  EXPECT_EQ(-1, valueAt(grid, 8.0, 0.0));
  for (int i = 1; i <= 3; ++i)
  {
    grid.add(SECOND + i * SECOND / 10, poseOf(0.0, 0.0, 0.0), viewOfWall(8.0), {}, {});
  }
  EXPECT_GE(valueAt(grid, 8.0, 0.0), 80);
  for (int i = 4; i <= 14; ++i)
  {
    grid.add(SECOND + i * SECOND / 10, poseOf(0.0, 0.0, 0.0), viewOfWall(11.0), {}, {});
  }
  EXPECT_LE(valueAt(grid, 8.0, 0.0), 35);
}

TEST(OccupancyGrid, DistancesThatAreHardlyKnownAreLeftOut)
{
  OccupancyGrid grid;
  grid.add(SECOND, poseOf(0.0, 0.0, 0.0), viewOfWall(8.0, 0.5), {}, {});
  EXPECT_EQ(-1, valueAt(grid, 8.0, 0.0));
}

TEST(OccupancyGrid, CellsFadeThatAreNotSeenAnyMore)
{
  OccupancyGrid grid;
  for (int i = 1; i <= 10; ++i)
  {
    grid.add(i * SECOND / 10, poseOf(0.0, 0.0, 0.0), viewOfWall(8.0), {}, {});
  }
  ASSERT_GE(valueAt(grid, 8.0, 0.0), 95);
  for (int i = 1; i <= 1200; ++i)
  {
    grid.add(SECOND + i * SECOND / 10, poseOf(0.0, 0.0, 0.0), GroundView(), {}, {});
  }
  EXPECT_EQ(-1, valueAt(grid, 8.0, 0.0)) << "four times memory_s";
}

TEST(OccupancyGrid, TheVehicleStandsOnFreeGround)
{
  OccupancyGrid grid;
  const Outline vehicle = {{-0.5, -0.6}, {1.0, -0.6}, {1.0, 0.6}, {-0.5, 0.6}};
  grid.add(SECOND, poseOf(3.0, 4.0, M_PI_2), GroundView(), {}, vehicle);
  EXPECT_LE(valueAt(grid, 3.0, 4.8), 45);
  EXPECT_EQ(-1, valueAt(grid, 3.8, 4.0));
}

TEST(OccupancyGrid, BeginsAnewWhenOdometryOrTimeDoes)
{
  OccupancyGrid grid;
  grid.add(10 * SECOND, poseOf(0.0, 0.0, 0.0), viewOfWall(8.0), {}, {});
  grid.add(11 * SECOND, poseOf(5.0, 0.0, 0.0), GroundView(), {}, {});
  EXPECT_EQ(-1, valueAt(grid, 8.0, 0.0)) << "no vehicle drives 5 m from one view to the next";
  grid.add(12 * SECOND, poseOf(5.0, 0.0, 0.0), viewOfWall(8.0), {}, {});
  grid.add(12 * SECOND, poseOf(5.0, 0.0, 0.0), GroundView(), {}, {});
  EXPECT_EQ(12 * SECOND, grid.stampNs());
  EXPECT_GE(valueAt(grid, 13.0, 0.0), 60);
  grid.add(SECOND, poseOf(5.0, 0.0, 0.0), GroundView(), {}, {});
  EXPECT_EQ(SECOND, grid.stampNs());
  EXPECT_EQ(-1, valueAt(grid, 13.0, 0.0));
}

TEST(OccupancyGrid, RefusesOptionsOutOfRange)
{
  OccupancyGridOptions options;
  options.cell_m = 0.0;
  EXPECT_THROW(OccupancyGrid{options}, std::invalid_argument);
}

}  // namespace
}  // namespace pi_detect
