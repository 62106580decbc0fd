#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <stdexcept>

#include <pi_runtime/kernels/corner_grid.h>

namespace pi_runtime::kernels
{

bool operator==(const Corner& a, const Corner& b)
{
  return a.x == b.x && a.y == b.y && a.score == b.score;
}

namespace
{

CornerGrid grid(int cell, int per_cell, float min_distance, size_t max_points = 1000)
{
  CornerGrid result;
  result.width = 200;
  result.height = 100;
  result.cell = cell;
  result.per_cell = per_cell;
  result.min_distance = min_distance;
  result.max_points = max_points;
  return result;
}

std::vector<Corner> randomCorners(size_t count)
{
  std::mt19937 random(5);
  std::vector<Corner> corners(count);
  for (Corner& corner : corners)
  {
    corner = Corner{static_cast<uint16_t>(random() % 200), static_cast<uint16_t>(random() % 100),
                    static_cast<int32_t>(random() % 255)};
  }
  return corners;
}

std::vector<Corner> select(const std::vector<Corner>& corners, const CornerGrid& grid,
                           const std::vector<Point2f>& existing = {})
{
  return selectGridCorners(corners.data(), corners.size(), grid, existing);
}

TEST(CornerGrid, TakesTheStrongestOfEachCell)
{
  const std::vector<Corner> corners = {{10, 10, 5}, {40, 40, 9}, {60, 10, 7}, {90, 40, 3}};

  EXPECT_EQ(select(corners, grid(50, 1, 0.0f)), (std::vector<Corner>{{40, 40, 9}, {60, 10, 7}}));
}

TEST(CornerGrid, ServesEveryCellBeforeASecondCornerOfOne)
{
  const std::vector<Corner> corners = {{10, 10, 100}, {40, 40, 90}, {60, 10, 2}};

  EXPECT_EQ(select(corners, grid(50, 2, 0.0f)), (std::vector<Corner>{{10, 10, 100}, {60, 10, 2}, {40, 40, 90}}));
  EXPECT_EQ(select(corners, grid(50, 2, 0.0f, 2)), (std::vector<Corner>{{10, 10, 100}, {60, 10, 2}}));
}

TEST(CornerGrid, TakesTheNextBestOfACellIfTheBestIsTooNear)
{
  const std::vector<Corner> corners = {{48, 20, 50}, {52, 20, 40}, {70, 20, 30}};

  EXPECT_EQ(select(corners, grid(50, 1, 10.0f)), (std::vector<Corner>{{48, 20, 50}, {70, 20, 30}}));
}

TEST(CornerGrid, KeepsAwayFromExistingPoints)
{
  const std::vector<Corner> corners = {{10, 10, 50}, {60, 20, 40}, {110, 20, 30}};
  const std::vector<Point2f> existing = {{30.0f, 30.0f}, {95.0f, 20.0f}};  // in the first and the second cell

  EXPECT_EQ(select(corners, grid(50, 1, 15.0f), existing), (std::vector<Corner>{{110, 20, 30}}));
  EXPECT_TRUE(select(corners, grid(50, 1, 15.5f), existing).empty());
}

TEST(CornerGrid, CountsExistingPointsOutsideOfTheImage)
{
  const std::vector<Corner> corners = {{10, 10, 50}};

  EXPECT_TRUE(select(corners, grid(50, 1, 5.0f), {{-3.0f, -1e9f}}).empty());
  EXPECT_EQ(select(corners, grid(50, 1, 5.0f), {{500.0f, 99.0f}}).size(), 1u);
}

TEST(CornerGrid, HoldsItsBoundsOnManyCorners)
{
  const CornerGrid bounds = grid(30, 2, 9.0f, 40);
  const std::vector<Corner> chosen = select(randomCorners(5000), bounds);

  EXPECT_EQ(chosen.size(), 40u);
  std::map<std::pair<int, int>, int> per_cell;
  for (size_t i = 0; i < chosen.size(); ++i)
  {
    EXPECT_LE((++per_cell[{chosen[i].x / 30, chosen[i].y / 30}]), 2);
    for (size_t k = 0; k < i; ++k)
    {
      EXPECT_GE(std::hypot(chosen[i].x - chosen[k].x, chosen[i].y - chosen[k].y), 9.0);
    }
  }
}

TEST(CornerGrid, ChoosesNothingFromNothing)
{
  EXPECT_TRUE(selectGridCorners(nullptr, 0, grid(30, 1, 5.0f)).empty());
  EXPECT_TRUE(select(randomCorners(10), grid(30, 1, 5.0f, 0)).empty());
}

TEST(CornerGrid, RefusesBadGridsAndCornersOutside)
{
  EXPECT_THROW(select({}, grid(0, 1, 5.0f)), std::invalid_argument);
  EXPECT_THROW(select({}, grid(30, 0, 5.0f)), std::invalid_argument);
  EXPECT_THROW(select({}, grid(30, 1, -1.0f)), std::invalid_argument);
  EXPECT_THROW(select({}, grid(30, 1, std::nanf(""))), std::invalid_argument);
  EXPECT_THROW(select({{200, 5, 1}}, grid(30, 1, 5.0f)), std::invalid_argument);
}

}  // namespace
}  // namespace pi_runtime::kernels
