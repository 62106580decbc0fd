#include <pi_vehicle/decision/ground_polygon.h>

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace pi_vehicle
{
namespace
{

using Points = std::vector<Eigen::Vector2d>;

bool inside(const Points& corners, const Eigen::Vector2d& p)
{
  for (size_t i = 0; i < corners.size(); ++i)
  {
    const Eigen::Vector2d side = corners[(i + 1) % corners.size()] - corners[i];
    const Eigen::Vector2d way = p - corners[i];
    if (side.x() * way.y() - side.y() * way.x() < 0.0)
    {
      return false;
    }
  }
  return true;
}

/// Whether one of many points of the rectangle is inside the polygon.
bool overlapBySampling(const Points& corners, const GroundRectangle& rectangle, double grow)
{
  constexpr int STEPS = 60;
  const Eigen::Vector2d across(-rectangle.along.y(), rectangle.along.x());
  for (int i = -STEPS; i <= STEPS; ++i)
  {
    for (int j = -STEPS; j <= STEPS; ++j)
    {
      if (inside(corners, rectangle.centre + i * (rectangle.half.x() + grow) / STEPS * rectangle.along +
                              j * (rectangle.half.y() + grow) / STEPS * across))
      {
        return true;
      }
    }
  }
  return false;
}

TEST(GroundPolygon, OverlapsARectangleExactly)
{
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  int both = 0;
  int apart = 0;
  for (int i = 0; i < 1000; ++i)
  {
    // A polygon with corners on an ellipse.
    const int n = 3 + static_cast<int>(8.0 * uniform(random));
    Points corners;
    for (int k = 0; k < n; ++k)
    {
      const double angle = 2.0 * M_PI * (k + 0.8 * uniform(random)) / n;
      corners.emplace_back(1.5 * std::cos(angle), 0.7 * std::sin(angle));
    }
    ASSERT_TRUE(GroundPolygon::isOutline(corners)) << i;
    const double heading = 6.0 * uniform(random);
    const GroundRectangle rectangle{{5.0 * uniform(random) - 2.5, 5.0 * uniform(random) - 2.5},
                                    {std::cos(heading), std::sin(heading)},
                                    {0.3 + uniform(random), 0.2 + 0.5 * uniform(random)}};
    const Eigen::Vector2d shift{uniform(random) - 0.5, uniform(random) - 0.5};
    const GroundRectangle back{rectangle.centre - shift, rectangle.along, rectangle.half};
    const bool found = GroundPolygon(corners).overlaps(rectangle, shift);
    // Samples lie 0.05 m apart at most: a little larger, and a little smaller, frame the truth.
    if (overlapBySampling(corners, back, -0.01))
    {
      ++both;
      EXPECT_TRUE(found) << i;
    }
    else if (!overlapBySampling(corners, back, 0.05))
    {
      ++apart;
      EXPECT_FALSE(found) << i;
    }
  }
  EXPECT_GT(both, 200);
  EXPECT_GT(apart, 200);
}

TEST(GroundPolygon, KeepsItsShapeInAnotherFrame)
{
  const Points corners = {{1.0, 0.0}, {3.0, 0.0}, {1.0, 1.0}};
  const GroundPolygon turned = GroundPolygon(corners).in({5.0, 2.0, M_PI_2}, {0.0, 1.0});
  const Points expected = {{5.0, 4.0}, {5.0, 6.0}, {4.0, 4.0}};
  ASSERT_EQ(3u, turned.corners().size());
  for (size_t i = 0; i < expected.size(); ++i)
  {
    EXPECT_LT((expected[i] - turned.corners()[i]).norm(), 1e-12);
    EXPECT_LE((turned.corners()[i] - turned.middle()).norm(), turned.radius() + 1e-12);
  }
  EXPECT_NEAR(5.0, turned.mostX(), 1e-12);
  const GroundRectangle beside{{4.2, 5.8}, Eigen::Vector2d::UnitX(), {0.1, 0.1}};
  EXPECT_FALSE(turned.overlaps(beside, Eigen::Vector2d::Zero())) << "beyond the longest side";
  EXPECT_TRUE(turned.overlaps(beside, {-0.7, 0.0}));
}

TEST(GroundPolygon, KnowsAnOutline)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(GroundPolygon::isOutline({{0, 0}, {2, 0}, {2, 1}, {0, 1}}));
  EXPECT_FALSE(GroundPolygon::isOutline({}));
  EXPECT_FALSE(GroundPolygon::isOutline({{0, 0}, {2, 0}}));
  EXPECT_FALSE(GroundPolygon::isOutline({{0, 0}, {1, 0}, {2, 0}})) << "a line";
  EXPECT_FALSE(GroundPolygon::isOutline({{0, 0}, {0, 1}, {2, 1}, {2, 0}})) << "clockwise";
  EXPECT_FALSE(GroundPolygon::isOutline({{0, 0}, {2, 0}, {0.5, 0.5}, {0, 2}})) << "a dent";
  EXPECT_FALSE(GroundPolygon::isOutline({{0, 0}, {2, 0}, {2, nan}}));
  EXPECT_FALSE(GroundPolygon::isOutline({{0, 0}, {1, 0}, {0, 1}, {0, 0}, {1, 0}, {0, 1}, {0.2, 0.1}}));
}

}  // namespace
}  // namespace pi_vehicle
