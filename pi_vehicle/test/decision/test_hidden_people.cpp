#include "decision/hidden_people.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace
{

using namespace pi_vehicle;
using namespace pi_vehicle::hidden_people;

constexpr double ADULT = 2.0;

TEST(HiddenPeople, AreBehindWhatIsWideAndHighEnough)
{
  const Eigen::Vector2d eye = Eigen::Vector2d::Zero();
  const auto box = [](double width) { return GroundPolygon::box({8.0, 0.0, 0.0}, {1.0, 0.5 * width}); };
  EXPECT_EQ(Who::ADULT, behind(box(1.2), eye, 1.8));
  EXPECT_EQ(Who::CHILD, behind(box(1.2), eye, 1.3)) << "an adult is seen over it";
  EXPECT_EQ(Who::NOBODY, behind(box(1.2), eye, 0.7));
  EXPECT_EQ(Who::NOBODY, behind(box(0.8), eye, 1.8)) << "its length along the line of sight does not count";
}

TEST(HiddenPeople, ComeFromTheFarEndOfTheSideTowardsTheWay)
{
  std::vector<Pose2> way;
  for (int i = 0; i < 100; ++i)
  {
    way.push_back(Pose2().moved(0.2 * i, 0.1));
  }
  const Pose2 beside = Pose2().moved(6.0, 0.1);
  const Eigen::Vector2d middle = beside * Eigen::Vector2d(0.0, -2.5);
  const GroundPolygon car = GroundPolygon::box({middle.x(), middle.y(), beside.heading}, {2.0, 0.9});
  const Edge edge = edgeOf(car, way, 0.6);
  EXPECT_NEAR(1.0, edge.gap, 0.2) << "2.5 - 0.9 - 0.6, and the bend";
  EXPECT_NEAR(6.0 + 2.0, edge.distance, 0.5);
}

TEST(HiddenPeople, BoundTheSpeedByTheTimeThatTheyTake)
{
  const Vehicle vehicle;
  // gap / speed - reaction = 0.5 s of braking with 2.5 m/s^2, from 1.75 m/s to 0.5 m/s.
  EXPECT_NEAR(1.5, allowedSpeed({vehicle.front + 0.01, 2.0}, ADULT, vehicle), 1e-9);
  EXPECT_NEAR(0.5, allowedSpeed({vehicle.front + 0.01, 0.5}, ADULT, vehicle), 1e-9) << "no time to brake";
  EXPECT_GT(allowedSpeed({vehicle.front + 6.5, 0.5}, ADULT, vehicle), 3.0) << "far from there it can still slow down";
  Vehicle slow_brakes = vehicle;
  slow_brakes.brakes_delay = 1.0;
  EXPECT_LT(allowedSpeed({vehicle.front + 4.0, 0.5}, ADULT, slow_brakes),
            allowedSpeed({vehicle.front + 4.0, 0.5}, ADULT, vehicle) - 0.3);
  EXPECT_GT(allowedSpeed({vehicle.front + 1.0, 2.0}, 1.4, vehicle),
            allowedSpeed({vehicle.front + 1.0, 2.0}, ADULT, vehicle));
}

TEST(HiddenPeople, ComeOutNearWhatHidThemTowardsTheWay)
{
  const GroundPolygon box = GroundPolygon::box({5.0, -2.5, 0.0}, {1.0, 0.5});
  const auto seen = [](double x, double y, double half) { return GroundPolygon::box({x, y, 0.3}, {half, half}); };
  std::vector<Pose2> way;
  for (int i = 0; i < 20; ++i)
  {
    way.push_back(Pose2().moved(0.5 * i, 0.0));
  }
  const Eigen::Vector2d walks(0.0, 0.6);
  EXPECT_TRUE(comesOut(seen(6.5, -2.0, 0.2), walks, box, way));
  EXPECT_FALSE(comesOut(seen(8.0, -2.0, 0.2), walks, box, way)) << "elsewhere";
  EXPECT_FALSE(comesOut(seen(5.0, -1.8, 0.2), walks, box, way)) << "before it";
  EXPECT_FALSE(comesOut(seen(6.5, -2.0, 0.8), walks, box, way)) << "larger than a person";
  EXPECT_FALSE(comesOut(seen(6.5, -2.0, 0.1), walks, box, way)) << "a pole";
  const Eigen::Vector2d ahead(6.3, -1.9);
  const Pose2 sight{ahead.x(), ahead.y(), std::atan2(ahead.y(), ahead.x())};
  EXPECT_TRUE(comesOut(GroundPolygon::box(sight, {1.0, 0.3}), walks, box, way)) << "its far side is hardly known";
  EXPECT_FALSE(comesOut(seen(6.5, -2.0, 0.2), {0.6, 0.1}, box, way)) << "along the way";
  EXPECT_TRUE(towards(way, {6.5, -2.0}).isApprox(Eigen::Vector2d(0.0, 1.0)));
  EXPECT_TRUE(towards(way, {6.5, 2.0}).isApprox(Eigen::Vector2d(0.0, -1.0)));
}

TEST(HiddenPeople, BoundNothingBesideAndBehindTheEdgeOrIfNobodyStepsOut)
{
  const double any = std::numeric_limits<double>::infinity();
  const Vehicle vehicle;
  EXPECT_EQ(any, allowedSpeed({vehicle.front, 1.0}, ADULT, vehicle));
  EXPECT_EQ(any, allowedSpeed({-3.0, 1.0}, ADULT, vehicle));
  EXPECT_EQ(any, allowedSpeed({4.0, -0.1}, ADULT, vehicle)) << "on the way: it stops for the obstacle itself";
  EXPECT_EQ(any, allowedSpeed({4.0, 1.0}, 0.0, vehicle));
}

}  // namespace
