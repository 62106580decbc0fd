#include "decision/ground_grid.h"

#include <gtest/gtest.h>

#include <cmath>

namespace pi_vehicle
{
namespace
{

/// 20 m x 10 m of free ground from (0, 0) on, in a map that is turned by 90 degrees.
struct Yard
{
  Yard() : cells(std::make_shared<std::vector<int8_t>>(200 * 100, 0))
  {
    grid.T_map_grid = {5.0, 5.0, M_PI_2};
    grid.cell_m = 0.1;
    grid.width = 200;
    grid.height = 100;
    grid.cells = cells;
  }
  void set(double x_from, double x_to, double y_from, double y_to, int8_t value)
  {
    for (int y = static_cast<int>(10 * y_from); y < static_cast<int>(10 * y_to); ++y)
    {
      for (int x = static_cast<int>(10 * x_from); x < static_cast<int>(10 * x_to); ++x)
      {
        (*cells)[static_cast<size_t>(y * 200 + x)] = value;
      }
    }
  }
  /// Corners of the way, in the yard.
  std::optional<std::vector<Eigen::Vector2d>> way(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double radius)
  {
    auto corners = findWay(grid, grid.T_map_grid * from, grid.T_map_grid * to, radius);
    for (size_t i = 0; corners && i < corners->size(); ++i)
    {
      (*corners)[i] = grid.T_map_grid.inverse() * (*corners)[i];
    }
    return corners;
  }

  std::shared_ptr<std::vector<int8_t>> cells;
  GroundGrid grid;
};

TEST(GroundGrid, TellsCellsByTheirPlaceInTheMap)
{
  Yard yard;
  yard.set(3.0, 4.0, 1.0, 2.0, 100);
  EXPECT_EQ(100, yard.grid.at({5.0 - 1.5, 5.0 + 3.5}));
  EXPECT_EQ(0, yard.grid.at({5.0 - 2.5, 5.0 + 3.5}));
  EXPECT_EQ(-1, yard.grid.at({5.0 + 0.5, 5.0 + 3.5}));
  EXPECT_EQ(-1, yard.grid.at({5.0 - 1.5, 5.0 + 20.5}));
}

TEST(GroundGrid, TheWayOverFreeGroundIsStraight)
{
  Yard yard;
  const auto corners = yard.way({2.0, 2.0}, {17.0, 8.0}, 0.8);
  ASSERT_TRUE(corners);
  ASSERT_EQ(1u, corners->size());
  EXPECT_LE((corners->front() - Eigen::Vector2d(17.0, 8.0)).norm(), 1e-9);
}

TEST(GroundGrid, TheWayLeadsThroughTheGapOfAWallInItsMiddle)
{
  Yard yard;
  yard.set(9.0, 9.5, 0.0, 10.0, 100);
  yard.set(9.0, 9.5, 7.0, 9.0, 0);
  const auto corners = yard.way({2.0, 2.0}, {17.0, 2.0}, 0.8);
  ASSERT_TRUE(corners);
  ASSERT_GE(corners->size(), 2u);
  EXPECT_LE(corners->size(), 5u);
  Eigen::Vector2d from(2.0, 2.0);
  for (const Eigen::Vector2d& to : *corners)
  {
    for (double part = 0.0; part <= 1.0; part += 0.01)
    {
      const Eigen::Vector2d p = from + part * (to - from);
      if (p.x() > 8.7 && p.x() < 9.8)
      {
        EXPECT_GE(p.y(), 7.6) << p.transpose();
        EXPECT_LE(p.y(), 8.4) << p.transpose();
      }
    }
    from = to;
  }
  EXPECT_FALSE(yard.way({2.0, 2.0}, {17.0, 2.0}, 1.3)) << "2 m are too narrow for 2.6 m";
}

TEST(GroundGrid, UnknownGroundIsAvoidedWhereTheKnownWayIsNotMuchLonger)
{
  Yard yard;
  yard.set(5.0, 15.0, 0.0, 4.0, -1);
  const auto corners = yard.way({2.0, 3.0}, {18.0, 3.0}, 0.5);
  ASSERT_TRUE(corners);
  ASSERT_GE(corners->size(), 2u);
  EXPECT_GE(corners->front().y(), 3.9);
  yard.set(5.0, 15.0, 0.0, 10.0, -1);
  ASSERT_TRUE(yard.way({2.0, 3.0}, {18.0, 3.0}, 0.5)) << "there is no other way";
}

TEST(GroundGrid, ThereIsNoWayFromOrToOutsideOrToWhatIsOccupied)
{
  Yard yard;
  yard.set(16.0, 18.0, 1.0, 3.0, 100);
  EXPECT_FALSE(yard.way({2.0, 2.0}, {17.0, 2.0}, 0.5));
  EXPECT_FALSE(yard.way({2.0, 2.0}, {21.0, 2.0}, 0.5));
  EXPECT_FALSE(yard.way({-2.0, 2.0}, {17.0, 8.0}, 0.5));
}

TEST(GroundGrid, WhatTheVehicleStandsBesideDoesNotKeepItThere)
{
  Yard yard;
  yard.set(2.0, 3.0, 2.6, 2.8, 100);
  EXPECT_TRUE(yard.way({2.5, 2.0}, {17.0, 2.0}, 0.8));
}

}  // namespace
}  // namespace pi_vehicle
