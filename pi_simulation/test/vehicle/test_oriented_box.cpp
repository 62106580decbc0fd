#include "vehicle/oriented_box.h"

#include <gtest/gtest.h>

#include <cmath>

namespace pi_simulation
{
namespace
{

TEST(OrientedBox, DistanceOfParallelBoxesIsTheGapBetweenThem)
{
  const OrientedBox vehicle{{0.25, 0.0}, 0.0, {0.75, 0.6}};
  EXPECT_NEAR(2.0, distanceBetween(vehicle, {{3.5, 0.3}, 0.0, {0.5, 0.5}}), 1e-12);
  EXPECT_NEAR(0.4, distanceBetween(vehicle, {{0.0, 1.5}, 0.0, {0.5, 0.5}}), 1e-12);
  EXPECT_NEAR(5.0, distanceBetween(vehicle, {{1.0 + 3.0 + 0.5, -0.6 - 4.0 - 0.5}, 0.0, {0.5, 0.5}}), 1e-12);
}

TEST(OrientedBox, TurnedBoxesAreNearestAtACorner)
{
  const OrientedBox vehicle{{0.0, 0.0}, 0.0, {1.0, 0.5}};
  const OrientedBox diamond{{4.0, 0.0}, M_PI_4, {1.0, 1.0}};
  EXPECT_NEAR(3.0 - std::sqrt(2.0), distanceBetween(vehicle, diamond), 1e-12);
  EXPECT_NEAR(distanceBetween(diamond, vehicle), distanceBetween(vehicle, diamond), 1e-12);
}

TEST(OrientedBox, CrossedBoxesOverlapThoughNoCornerIsInside)
{
  const OrientedBox lying{{0.0, 0.0}, 0.0, {3.0, 0.2}};
  const OrientedBox standing{{0.5, 0.0}, M_PI_2, {3.0, 0.2}};
  EXPECT_EQ(0.0, distanceBetween(lying, standing));
  EXPECT_EQ(0.0, distanceBetween(lying, {{1.0, 0.1}, 0.3, {0.05, 0.05}}));
}

TEST(OrientedBox, DistanceOfAPoint)
{
  const OrientedBox box{{2.0, 0.0}, M_PI_2, {1.0, 0.5}};
  EXPECT_NEAR(1.5, distanceTo(box, {0.0, 0.0}), 1e-12);
  EXPECT_EQ(0.0, distanceTo(box, {2.2, 0.9}));
}

}  // namespace
}  // namespace pi_simulation
