#include "decision/passing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace pi_vehicle
{
namespace
{

constexpr double LANE = 60.0;  // along x, from (0, 0) [m]

KnownObstacle box(int64_t id, double x, double y, double half_width = 0.5)
{
  KnownObstacle obstacle;
  obstacle.id = id;
  obstacle.outline = GroundPolygon::box({x, y, 0.0}, {0.5, half_width});
  obstacle.standing_s = 5.0;
  return obstacle;
}

/// A lane whose surroundings are free and seen, with things on it.
class Lane
{
public:
  explicit Lane(const PassingOptions& options = PassingOptions())
    : passing(options, pi_node::Footprint(), pi_node::MotionLimits())
    , cells(std::make_shared<std::vector<int8_t>>(800 * 200, 0))
  {
    std::vector<Eigen::Vector2d> points;
    for (double x = 0.0; x <= LANE; x += 0.1)
    {
      points.emplace_back(x, 0.0);
    }
    passing.setRoute(Path(points));
    grid.T_map_grid = {-10.0, -10.0, 0.0};
    grid.cell_m = 0.1;
    grid.width = 800;
    grid.height = 200;
    grid.cells = cells;
  }

  void set(double x_from, double x_to, double y_from, double y_to, int8_t value)
  {
    for (int y = static_cast<int>(10 * (y_from + 10.0)); y < static_cast<int>(10 * (y_to + 10.0)); ++y)
    {
      for (int x = static_cast<int>(10 * (x_from + 10.0)); x < static_cast<int>(10 * (x_to + 10.0)); ++x)
      {
        (*cells)[static_cast<size_t>(y * 800 + x)] = value;
      }
    }
  }

  /// As long as it takes to know what is in the way, or to find a path.
  PassingOutput look(const Pose2& pose, double speed = 2.0)
  {
    PassingOutput output;
    for (int i = 0; i < 4 && !output.path; ++i)
    {
      output = update(pose, speed);
    }
    return output;
  }

  PassingOutput update(const Pose2& pose, double speed = 2.0)
  {
    PassingInput input;
    input.now_ns = now_ns += 500'000'000;
    input.pose = pose;
    input.speed = speed;
    input.ground = seen ? &grid : nullptr;
    for (KnownObstacle obstacle : obstacles)
    {
      obstacle.outline = obstacle.outline.in(pose.inverse());
      obstacle.velocity = Pose2{0.0, 0.0, -pose.heading} * obstacle.velocity;
      input.obstacles.push_back(obstacle);
    }
    return passing.update(input);
  }

  Passing passing;
  std::shared_ptr<std::vector<int8_t>> cells;
  GroundGrid grid;
  bool seen = true;
  std::vector<KnownObstacle> obstacles;
  int64_t now_ns = 1'000'000'000'000;
};

double leastGap(const Path& path, const KnownObstacle& obstacle)
{
  double gap = std::numeric_limits<double>::infinity();
  for (double margin = 0.0; margin < 3.0; margin += 0.05)
  {
    for (double s = 0.0; s <= path.length(); s += 0.2)
    {
      const PathPoint p = path.at(s);
      const Eigen::Vector2d along(std::cos(p.heading), std::sin(p.heading));
      if (obstacle.outline.overlaps({p.pose() * Eigen::Vector2d(0.25, 0.0), along, {0.75, 0.6 + margin}},
                                    Eigen::Vector2d::Zero()))
      {
        return margin;
      }
    }
  }
  return gap;
}

TEST(Passing, TheWayRoundABoxKeepsTheClearanceAndLeadsBack)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0)};
  const PassingOutput output = lane.look({12.0, 0.0, 0.0});
  ASSERT_TRUE(output.path) << output.reason;
  EXPECT_EQ(7, output.obstacle_id);
  EXPECT_EQ(1.5, output.speed_limit);
  EXPECT_NE(std::string::npos, output.reason.find("on the left")) << output.reason;
  EXPECT_GE(leastGap(*output.path, lane.obstacles[0]), 0.45);
  const double beside = output.path->project({25.0, 2.0, 0.0}).s;
  EXPECT_GE(output.path->at(beside).y, 1.6);
  EXPECT_LE(output.path->at(beside).y, 2.3);
  EXPECT_NEAR(0.0, output.path->at(output.path->length()).y, 1e-9);
  EXPECT_NEAR(0.0, output.path->at(output.path->project({42.0, 0.0, 0.0}).s).y, 1e-9);
  for (const PathPoint& point : output.path->points())
  {
    EXPECT_LE(std::abs(point.curvature), 0.42) << point.x;
  }
}

TEST(Passing, NothingIsDoneWhereNothingStandsOnTheRoute)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 1.6)};
  const PassingOutput output = lane.look({12.0, 0.0, 0.0});
  EXPECT_FALSE(output.path);
  EXPECT_TRUE(std::isinf(output.speed_limit));
  EXPECT_EQ("", output.reason);
}

TEST(Passing, WaitsAtADistanceWhileTheOtherLaneIsNotSeen)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0)};
  lane.set(18.0, 40.0, 0.8, 5.0, -1);
  const PassingOutput far = lane.look({9.0, 0.0, 0.0});
  EXPECT_FALSE(far.path);
  EXPECT_GT(far.speed_limit, 1.0);
  const PassingOutput near = lane.look({16.5, 0.0, 0.0});
  EXPECT_FALSE(near.path);
  EXPECT_LT(near.speed_limit, 0.1);
  EXPECT_NE(std::string::npos, near.reason.find("something 1.0 m wide (obstacle 7) blocks the way; the way round on "
                                                "the left is not visible"))
      << near.reason;
  lane.set(18.0, 40.0, 0.8, 5.0, 0);
  EXPECT_TRUE(lane.look({16.5, 0.0, 0.0}, 0.0).path) << "there is room from where it waits";
}

TEST(Passing, WithoutAGridOfTheGroundNothingIsPassed)
{
  Lane lane;
  lane.seen = false;
  lane.obstacles = {box(7, 25.0, 0.0)};
  const PassingOutput output = lane.look({12.0, 0.0, 0.0});
  EXPECT_FALSE(output.path);
  EXPECT_NE(std::string::npos, output.reason.find("there is no grid of the ground")) << output.reason;
  EXPECT_TRUE(std::isinf(lane.update({17.0, 0.0, 0.0}).speed_limit)) << "nothing to wait for";
}

TEST(Passing, WaitsForWhoeverComesOnTheOtherLane)
{
  Lane lane;
  KnownObstacle car = box(8, 34.0, 2.0);
  car.moving = true;
  car.label = "car";
  car.velocity = {-2.0, 0.0};
  lane.obstacles = {box(7, 25.0, 0.0), car};
  const PassingOutput output = lane.look({12.0, 0.0, 0.0});
  EXPECT_FALSE(output.path);
  EXPECT_NE(std::string::npos, output.reason.find("is taken by obstacle 8 (car)")) << output.reason;
  lane.obstacles[1].velocity = {3.0, 0.0};
  lane.obstacles[1].outline = GroundPolygon::box({45.0, 2.0, 0.0}, {1.0, 0.5});
  EXPECT_TRUE(lane.look({12.0, 0.0, 0.0}).path) << "it drives away";
}

TEST(Passing, StaysWithinWhatIsAllowed)
{
  PassingOptions options;
  options.left = 1.0;
  Lane lane(options);
  lane.obstacles = {box(7, 25.0, 0.0)};
  const PassingOutput output = lane.look({12.0, 0.0, 0.0});
  EXPECT_FALSE(output.path);
  EXPECT_NE(std::string::npos, output.reason.find("there is no room beside it within 1.0 m left and 1.0 m right"))
      << output.reason;
  options.right = 4.0;
  Lane right(options);
  right.obstacles = {box(7, 25.0, 0.0)};
  const PassingOutput round = right.look({12.0, 0.0, 0.0});
  ASSERT_TRUE(round.path) << round.reason;
  EXPECT_NE(std::string::npos, round.reason.find("on the right")) << round.reason;
}

TEST(Passing, PeopleAreWaitedForAndWhatCameJustNowIsNotPassed)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0, 0.3)};
  lane.obstacles[0].label = "person";
  const PassingOutput output = lane.look({13.0, 0.0, 0.0});
  EXPECT_FALSE(output.path);
  EXPECT_NE(std::string::npos, output.reason.find("it is waited for")) << output.reason;
  lane.obstacles[0].label = "";
  lane.obstacles[0].outline = GroundPolygon::box({25.0, 0.0, 0.0}, {0.25, 0.3});
  lane.obstacles[0].top = 1.7;
  EXPECT_FALSE(lane.look({13.0, 0.0, 0.0}).path) << "by its size it may be a person";
  lane.obstacles[0].top = 0.7;
  lane.obstacles[0].standing_s = 0.2;
  EXPECT_FALSE(lane.look({13.0, 0.0, 0.0}).path);
  lane.obstacles[0].standing_s = 2.0;
  EXPECT_TRUE(lane.look({13.0, 0.0, 0.0}).path);
}

TEST(Passing, APersonIsTakenForOneThoughItsDepthIsHardlyKnown)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0, 0.25)};
  lane.obstacles[0].outline = GroundPolygon::box({25.0, 0.0, 0.0}, {0.8, 0.25});
  lane.obstacles[0].top = 1.7;
  EXPECT_FALSE(lane.look({17.0, 0.0, 0.0}).path);
}

TEST(Passing, StopsBesideNobodyWhoTurnsOutToBeAPerson)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0)};
  ASSERT_TRUE(lane.look({17.0, 0.0, 0.0}).path);
  EXPECT_EQ(1.5, lane.update({19.0, 0.3, 0.2}).speed_limit);
  lane.obstacles[0].label = "person";
  const PassingOutput waits = lane.update({22.0, 0.8, 0.2});
  EXPECT_LT(waits.speed_limit, 1.0) << "0.5 m before the clearance to people";
  EXPECT_NE(std::string::npos, waits.reason.find("(obstacle 7) blocks the way; it is waited for")) << waits.reason;
  EXPECT_EQ(0.0, lane.update({22.7, 0.8, 0.2}).speed_limit);
  EXPECT_EQ(1.5, lane.update({25.0, 2.0, 0.0}).speed_limit) << "beside it already";
  lane.obstacles[0].outline = GroundPolygon::box({25.0, -4.0, 0.0}, {0.5, 0.5});
  EXPECT_EQ(1.5, lane.update({22.7, 0.8, 0.2}).speed_limit) << "has left the way";
}

TEST(Passing, WhatIsInTheWayForMomentsOnlyIsNotPassed)
{
  Lane lane;
  for (int i = 0; i < 10; ++i)
  {
    lane.obstacles = {box(i % 2, 22.0, 0.0)};
    EXPECT_FALSE(lane.update({12.0, 0.0, 0.0}).path) << i;
    lane.obstacles = {box(7, 22.0, i % 2 == 0 ? 0.0 : 2.0)};
    EXPECT_FALSE(lane.update({12.0, 0.0, 0.0}).path) << i;
  }
  lane.obstacles = {box(7, 22.0, 0.0)};
  EXPECT_TRUE(lane.look({12.0, 0.0, 0.0}).path);
}

TEST(Passing, TwoThingsBehindEachOtherArePassedInOneGo)
{
  Lane lane;
  lane.obstacles = {box(7, 22.0, 0.0), box(8, 29.0, 0.0)};
  const PassingOutput output = lane.look({9.5, 0.0, 0.0});
  ASSERT_TRUE(output.path) << output.reason;
  EXPECT_GE(leastGap(*output.path, lane.obstacles[0]), 0.45);
  EXPECT_GE(leastGap(*output.path, lane.obstacles[1]), 0.45);
}

TEST(Passing, LooksAgainWhereTheWayRoundTurnsOutToBeBlocked)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0)};
  const PassingOutput first = lane.look({12.0, 0.0, 0.0});
  ASSERT_TRUE(first.path);
  for (double x = 14.0; x < 21.0; x += 2.0)
  {
    lane.update(first.path->at(first.path->project({x, 1.8, 0.0}).s).pose());
  }
  const Pose2 beside = first.path->at(first.path->project({21.0, 1.8, 0.0}).s).pose();
  lane.obstacles.push_back(box(8, 31.0, 0.0));  // was hidden by the first
  const PassingOutput second = lane.look(beside, 1.5);
  ASSERT_TRUE(second.path) << second.reason;
  EXPECT_GE(leastGap(*second.path, lane.obstacles[1]), 0.45);
  const PathProjection here = second.path->project(beside);
  EXPECT_LE(std::abs(here.cross_track), 0.05) << "it begins where the vehicle is";
  EXPECT_LE(std::abs(here.heading_error), 0.1);
}

TEST(Passing, OnTheRouteAgainTheSpeedIsTheVehiclesOwn)
{
  Lane lane;
  lane.obstacles = {box(7, 25.0, 0.0)};
  ASSERT_TRUE(lane.look({12.0, 0.0, 0.0}).path);
  for (double x = 14.0; x <= 25.0; x += 2.0)
  {
    EXPECT_EQ(1.5, lane.update({x, x < 20.0 ? 0.0 : 1.9, 0.0}).speed_limit) << x;
  }
  for (double x = 26.0; x < 39.0; x += 2.0)
  {
    lane.update({x, 0.0, 0.0});
  }
  const PassingOutput output = lane.update({39.0, 0.0, 0.0});
  EXPECT_TRUE(std::isinf(output.speed_limit));
  EXPECT_EQ("", output.reason);
}

TEST(Passing, RoundARoadTheWayRoundIsShiftedFromTheBend)
{
  Lane lane;
  std::vector<Eigen::Vector2d> circle;
  for (double angle = 0.0; angle < 2.0 * M_PI - 0.01; angle += 0.01)
  {
    circle.emplace_back(20.0 * std::cos(angle), 20.0 * std::sin(angle));
  }
  lane.cells->assign(800 * 800, 0);
  lane.grid.T_map_grid = {-40.0, -40.0, 0.0};
  lane.grid.height = 800;
  lane.passing.setRoute(Path(circle, true));
  lane.obstacles = {box(7, 20.0 * std::cos(0.2), 20.0 * std::sin(0.2))};
  const PassingOutput output = lane.look({20.0 * std::cos(0.4), -20.0 * std::sin(0.4), M_PI_2 - 0.4});
  ASSERT_TRUE(output.path) << output.reason;
  EXPECT_TRUE(output.path->closed());
  EXPECT_GE(leastGap(*output.path, lane.obstacles[0]), 0.45);
}

TEST(Passing, RefusesOptionsOutOfRange)
{
  PassingOptions options;
  options.clearance = 0.1;
  EXPECT_THROW(Passing(options, pi_node::Footprint(), pi_node::MotionLimits()), std::invalid_argument);
}

}  // namespace
}  // namespace pi_vehicle
