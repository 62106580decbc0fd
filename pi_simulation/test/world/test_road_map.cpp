#include "world/road_map.h"

#include <gtest/gtest.h>

#include <cmath>

using pi_simulation::synthetic::RoadMap;

namespace
{

std::vector<Eigen::Vector2d> straight(double length_m)
{
  std::vector<Eigen::Vector2d> line;
  for (double x = 0.0; x <= length_m; x += 1.0)
  {
    line.emplace_back(x, 5.0);
  }
  return line;
}

}  // namespace

TEST(RoadMap, KnowsDistanceAcrossAndAlong)
{
  const RoadMap road(straight(30.0));
  for (const float y : {5.0f, 5.06f, 4.9f, 6.13f, 2.7f, 9.9f})
  {
    const RoadMap::Place place = road.at(12.3f, y);
    EXPECT_NEAR(place.lateral, std::abs(y - 5.0f), 0.01f) << y;
    EXPECT_NEAR(place.along, 12.3f, 0.01f) << y;
    EXPECT_NEAR(std::abs(place.dy), 1.0f, 0.01f) << y;
    EXPECT_NEAR(place.dx, 0.0f, 0.01f) << y;
  }
}

TEST(RoadMap, IsConstantOutOfReach)
{
  const RoadMap road(straight(30.0));
  EXPECT_EQ(road.at(12.0f, 500.0f).lateral, RoadMap::REACH_M);
  EXPECT_EQ(road.at(-500.0f, 5.0f).lateral, RoadMap::REACH_M);
  EXPECT_EQ(RoadMap().at(0.0f, 0.0f).lateral, RoadMap::REACH_M);
}

TEST(RoadMap, DoesNotMixPositionsWhereALoopCloses)
{
  std::vector<Eigen::Vector2d> line;
  for (int i = 0; i <= 100; ++i)
  {
    line.emplace_back(20.0 * std::cos(0.0628318 * i), 20.0 * std::sin(0.0628318 * i));
  }
  const RoadMap road(line);
  for (float y = -1.0f; y < 1.0f; y += 0.01f)
  {
    const float along = road.at(20.0f, y).along;
    EXPECT_TRUE(along < 1.2f || along > 124.4f) << y << " " << along;
  }
}
