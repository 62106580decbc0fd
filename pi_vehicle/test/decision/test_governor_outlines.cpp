#include "decision/speed_governor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "test_values.h"

namespace
{

using namespace pi_vehicle;

/// A parked car, 4.4 m x 1.8 m, at an angle to the vehicle, with the box around it.
ObstacleBox makeParkedCar(const Eigen::Vector2d& middle, double heading)
{
  ObstacleBox car;
  car.id = 7;
  car.position = middle;
  car.moving = false;
  car.outline = GroundPolygon::box({middle.x(), middle.y(), heading}, {2.2, 0.9}).corners();
  for (const Eigen::Vector2d& corner : car.outline)
  {
    car.size = car.size.cwiseMax(2.0 * (corner - middle).cwiseAbs());
  }
  return car;
}

/// What it says to an obstacle that it sees for the first time, at 2.5 m/s.
GovernorOutput decide(const ObstacleBox& obstacle, double curvature)
{
  SpeedGovernor governor;
  GovernorInput input;
  input.speed = 2.5;
  input.curvature = curvature;
  for (int i = 1; i <= 60; ++i)
  {
    input.now_ns = i * 50 * MS;
    governor.setObstacles(input.now_ns, {});
    governor.update(input);
  }
  EXPECT_TRUE(governor.setObstacles(input.now_ns + MS, {obstacle}));
  input.now_ns += 2 * MS;
  return governor.update(input);
}

TEST(GovernorOutlines, LeavesTheWayFreeBesideAnObliqueCarInABend)
{
  // The car stands along the outer side of a bend to the left: 0.7 m are free beside the vehicle.
  const double curvature = 0.16;
  const Pose2 beside = Pose2().moved(5.0, curvature);
  const ObstacleBox car = makeParkedCar(beside * Eigen::Vector2d(0.0, -2.2), beside.heading);
  const GovernorOutput with_outline = decide(car, curvature);
  EXPECT_FALSE(with_outline.emergency) << with_outline.reason;
  EXPECT_GT(with_outline.speed_limit, 2.4) << with_outline.reason;
  ObstacleBox box = car;
  box.outline.clear();
  EXPECT_LT(decide(box, curvature).speed_limit, 2.0) << "its box reaches into the way";
  // The same car in the way.
  const GovernorOutput blocked = decide(makeParkedCar(beside * Eigen::Vector2d(0.0, -0.8), beside.heading), curvature);
  EXPECT_LT(blocked.speed_limit, 2.0);
  EXPECT_EQ(blocked.obstacle_id, 7);
}

TEST(GovernorOutlines, DrivesAlongAWallSeenObliquely)
{
  ObstacleBox wall;
  wall.id = 3;
  wall.moving = false;
  wall.position = {8.0, -0.5};
  wall.size = {8.0, 5.0};
  const double curvature = 0.15;
  std::vector<Eigen::Vector2d> outer;
  for (const double s : {3.0, 5.5, 8.0})
  {
    outer.push_back(Pose2().moved(s, curvature) * Eigen::Vector2d(0.0, -1.2));
  }
  // The chord of the outer edge, 0.2 m thick.
  const Eigen::Vector2d along = (outer[2] - outer[0]).normalized();
  const Eigen::Vector2d out(along.y(), -along.x());
  const double bulge = std::max(0.0, out.dot(outer[1] - outer[0]));
  const Eigen::Vector2d a = outer[0] + bulge * out;
  const Eigen::Vector2d b = outer[2] + bulge * out;
  wall.outline = {a, a + 0.2 * out, b + 0.2 * out, b};
  ASSERT_TRUE(GroundPolygon::isOutline(wall.outline));
  const GovernorOutput output = decide(wall, curvature);
  EXPECT_FALSE(output.emergency) << output.reason;
  EXPECT_GT(output.speed_limit, 2.0) << output.reason;
  EXPECT_EQ(decide(wall, 0.0).speed_limit, 0.0) << "straight on there is the wall";
}

TEST(GovernorOutlines, TakesTheBoxWhereTheOutlineIsOdd)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ObstacleBox box;
  box.id = 1;
  box.moving = false;
  box.position = {5.0, 0.0};
  box.size = {0.5, 0.5};
  const std::vector<std::vector<Eigen::Vector2d>> odd = {
      {{4.0, 5.0}, {5.0, 5.0}},
      {{4.0, 5.0}, {5.0, nan}, {5.0, 6.0}},
      {{4.0, 5.0}, {4.0, 6.0}, {5.0, 5.0}},              // clockwise
      {{4.0, 5.0}, {5.0, 5.0}, {4.5, 5.2}, {4.5, 6.0}},  // a dent
  };
  for (const auto& outline : odd)
  {
    SpeedGovernor governor;
    box.outline = outline;
    GovernorInput input;
    input.now_ns = 1000 * MS;
    input.speed = 2.0;
    governor.update(input);
    EXPECT_FALSE(governor.setObstacles(input.now_ns, {box}));
    EXPECT_EQ(governor.update(input).obstacle_id, 1);
  }
}

}  // namespace
