#include <gtest/gtest.h>
#include <pi_detect/outline.h>

#include <cmath>
#include <random>

namespace pi_detect
{
namespace
{

using Points = std::vector<Eigen::Vector2d>;

Points randomPoints(unsigned seed, size_t count)
{
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Points points;
  for (size_t i = 0; i < count; ++i)
  {
    points.push_back({3.0 * normal(random), normal(random)});
  }
  return points;
}

bool isConvex(const Outline& outline)
{
  for (size_t i = 0; i < outline.size(); ++i)
  {
    const Eigen::Vector2d a = outline[(i + 1) % outline.size()] - outline[i];
    const Eigen::Vector2d b = outline[(i + 2) % outline.size()] - outline[(i + 1) % outline.size()];
    if (a.x() * b.y() - a.y() * b.x() < 0.0)
    {
      return false;
    }
  }
  return outline.size() >= 3;
}

TEST(Outline, IsTheLeastOneAroundPoints)
{
  const Points square = {{0, 0}, {2, 1}, {2, 0}, {1, 1}, {0, 1}, {1, 0.5}, {1, 0}, {0, 0}};
  const Outline outline = convexHull(square);
  ASSERT_EQ(outline.size(), 4U);
  EXPECT_NEAR(areaOf(outline), 2.0, 1e-12) << "counter-clockwise: above 0";
  const OutlineBounds bounds = boundsOf(outline);
  EXPECT_EQ(bounds.low, Eigen::Vector2d(0, 0));
  EXPECT_EQ(bounds.high, Eigen::Vector2d(2, 1));
}

TEST(Outline, OfALineIsNone)
{
  EXPECT_TRUE(convexHull({}).empty());
  EXPECT_TRUE(convexHull({{1, 1}}).empty());
  EXPECT_TRUE(convexHull({{1, 1}, {1, 1}, {1, 1}}).empty());
  EXPECT_TRUE(convexHull({{0, 0}, {1, 1}, {3, 3}, {2, 2}}).empty());
}

TEST(Outline, HoldsAllPointsWithFewerCornersToo)
{
  for (unsigned seed = 1; seed <= 200; ++seed)
  {
    const Points points = randomPoints(seed, 3 + seed);
    Outline outline = convexHull(points);
    ASSERT_TRUE(isConvex(outline)) << seed;
    const double area = areaOf(outline);
    for (const size_t most : {MAX_OUTLINE_CORNERS, size_t{6}, size_t{4}})
    {
      limitCorners(&outline, most);
      EXPECT_LE(outline.size(), most);
      EXPECT_TRUE(isConvex(outline)) << seed;
      for (const Eigen::Vector2d& point : points)
      {
        EXPECT_TRUE(contains(outline, point, 1e-6)) << seed;
      }
    }
    EXPECT_LT(areaOf(outline), 2.5 * area + 0.1) << "a quadrangle around it is not much larger";
  }
}

TEST(Outline, ContainsWhatIsInsideOrNear)
{
  const Outline outline = convexHull({{0, 0}, {4, 0}, {0, 4}});
  EXPECT_TRUE(contains(outline, {1, 1}));
  EXPECT_TRUE(contains(outline, {2, 2}));
  EXPECT_FALSE(contains(outline, {2.1, 2.1}));
  EXPECT_TRUE(contains(outline, {2.1, 2.1}, 0.15));
  EXPECT_FALSE(contains(Outline(), {0, 0}));
}

TEST(Outline, IsCutAlongALine)
{
  const Outline outline = convexHull({{0, 0}, {4, 0}, {4, 2}, {0, 2}});
  const Outline upper = leftOf(outline, {0, 1}, {1, 0});
  EXPECT_NEAR(areaOf(upper), 4.0, 1e-12);
  EXPECT_TRUE(isConvex(upper));
  EXPECT_TRUE(contains(upper, {2, 1.5}));
  EXPECT_FALSE(contains(upper, {2, 0.5}));
  EXPECT_NEAR(areaOf(leftOf(outline, {0, -1}, {1, 0})), 8.0, 1e-12);
  EXPECT_TRUE(leftOf(outline, {0, 3}, {1, 0}).empty());
}

}  // namespace
}  // namespace pi_detect
