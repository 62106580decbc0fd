// Navigator with a simulated car around it.

#include "decision/navigator.h"

#include "simulated_car.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_vehicle
{
namespace
{

constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
constexpr int64_t PERIOD_NS = 50'000'000;
constexpr int PHYSICS = 5;  // steps of the car per update

NavigationGoal to(const std::vector<Eigen::Vector2d>& points, std::optional<double> heading = std::nullopt)
{
  NavigationGoal goal;
  for (const Eigen::Vector2d& point : points)
  {
    goal.waypoints.push_back({point, std::nullopt});
  }
  goal.waypoints.back().heading = heading;
  return goal;
}

class Simulation
{
public:
  explicit Simulation(const NavigatorOptions& options = NavigatorOptions(), const Pose2& start = Pose2())
    : navigator(options), car(start)
  {
    runFor(2.0);  // obstacles are known from here on
  }

  NavigatorInput input() const
  {
    NavigatorInput input;
    input.now_ns = now_ns;
    input.pose_stamp_ns = now_ns - 20'000'000;
    if (localised)
    {
      const Pose2 pose = car.pose();
      input.pose = {pose.x + shift.x(), pose.y + shift.y(), pose.heading};
    }
    else
    {
      input.pose_problem = "the lamp is out";
    }
    input.position_deviation = deviation;
    input.vehicle_ns = vehicle_heard ? now_ns : vehicle_ns_;
    input.speed = car.speed();
    input.curvature = car.curvature();
    input.vehicle_problem = vehicle_problem;
    return input;
  }

  void step()
  {
    now_ns += PERIOD_NS;
    if (obstacles_heard && ++count_ % 2 == 0)
    {
      std::vector<ObstacleBox> boxes;
      for (const Eigen::Vector2d& place : obstacles)
      {
        ObstacleBox box;
        box.id = 7;
        box.position = car.pose().inverse() * place;
        box.size = {0.5, 0.5};
        box.moving = false;
        boxes.push_back(box);
      }
      EXPECT_EQ("", navigator.setObstacles(now_ns, boxes, now_ns));
    }
    const NavigatorInput in = input();
    vehicle_ns_ = in.vehicle_ns;
    output = navigator.update(in);
    EXPECT_EQ("navigation", output.command.source);
    EXPECT_FALSE(output.command.reason.empty());
    for (int i = 0; i < PHYSICS; ++i)
    {
      car.step(output.command, 1e-9 * PERIOD_NS / PHYSICS);
    }
    max_speed = std::max(max_speed, car.speed());
  }

  void runFor(double time_s)
  {
    for (int64_t end = now_ns + static_cast<int64_t>(1e9 * time_s); now_ns < end;)
    {
      step();
    }
  }
  bool runUntil(const std::function<bool()>& condition, double limit_s = 120.0)
  {
    for (int64_t end = now_ns + static_cast<int64_t>(1e9 * limit_s); now_ns < end;)
    {
      step();
      if (condition())
      {
        return true;
      }
    }
    return false;
  }
  bool runToEnd(DriveEnd end)
  {
    return runUntil([this] { return output.end != DriveEnd::NONE; }) && output.end == end;
  }
  bool runToStandstill(NavigatorState state)
  {
    return runUntil([this, state] { return output.state == state && std::abs(car.speed()) < 0.02; });
  }
  bool drives() const { return output.state == NavigatorState::DRIVING && car.speed() > 0.3; }
  double distanceTo(const Eigen::Vector2d& point) const { return (car.pose().position() - point).norm(); }
  std::string text() const
  {
    return std::string(toString(output.state)) + ": " + output.command.reason + " at " + std::to_string(car.pose().x) +
           ", " + std::to_string(car.pose().y);
  }

  Navigator navigator;
  SimulatedCar car;
  int64_t now_ns = 1'000'000'000'000;
  bool localised = true;
  double deviation = 0.1;
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();  // of the pose that is told
  bool vehicle_heard = true;
  std::string vehicle_problem;
  bool obstacles_heard = true;
  std::vector<Eigen::Vector2d> obstacles;  // in the map
  NavigatorOutput output;
  double max_speed = 0.0;

private:
  int64_t vehicle_ns_ = 0;
  unsigned count_ = 0;
};

TEST(Navigator, ArrivesOverWaypointsWithTheHeadingAskedFor)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{15.0, 0.0}, {15.0, 20.0}}, M_PI_2), sim.input()));
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_LE(sim.distanceTo({15.0, 20.0}), 0.2);
  EXPECT_NEAR(M_PI_2, sim.car.pose().heading, 0.15);
  EXPECT_EQ(1.0, sim.output.progress);
  EXPECT_NEAR(sim.car.travel(), sim.output.distance, 0.5);
  EXPECT_GT(sim.output.duration_s, 10.0);
  EXPECT_GT(sim.max_speed, 2.0);
  EXPECT_LE(sim.max_speed, 3.1);
  EXPECT_FALSE(sim.navigator.active());
  sim.step();
  EXPECT_EQ("no goal", sim.output.command.reason);
  EXPECT_EQ(DriveEnd::NONE, sim.output.end);
  EXPECT_TRUE(sim.navigator.path().empty());
}

TEST(Navigator, KnowsWhichPointsLieBehind)
{
  Simulation sim;
  const NavigationGoal goal = to({{8.0, 0.0}, {16.0, 4.0}, {24.0, 4.0}});
  ASSERT_EQ("", sim.navigator.start(goal, sim.input()));
  for (size_t i = 0; i < goal.waypoints.size(); ++i)
  {
    EXPECT_EQ(i, sim.navigator.passed());
    const double x = goal.waypoints[i].position.x();
    ASSERT_TRUE(sim.runUntil([&] { return sim.car.pose().x > x - 1.0; })) << sim.text();
    EXPECT_EQ(i, sim.navigator.passed()) << sim.text();
    if (i + 1 < goal.waypoints.size())
    {
      ASSERT_TRUE(sim.runUntil([&] { return sim.car.pose().x > x + 1.0; })) << sim.text();
    }
  }
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_EQ(3u, sim.navigator.goal().waypoints.size());
}

TEST(Navigator, StandsWithoutAGoal)
{
  Simulation sim;
  EXPECT_EQ(NavigatorState::IDLE, sim.output.state);
  EXPECT_EQ("no goal", sim.output.command.reason);
  EXPECT_EQ(0.0, sim.output.command.speed);
  EXPECT_EQ(0.0, sim.car.travel());
}

TEST(Navigator, IsNoFasterThanTheGoalAllows)
{
  Simulation sim;
  NavigationGoal goal = to({{20.0, 0.0}});
  goal.max_speed = 0.8;
  ASSERT_EQ("", sim.navigator.start(goal, sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.output.limited_by == "goal"; })) << sim.text();
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_LE(sim.max_speed, 0.81);
}

TEST(Navigator, StopsBeforeAnObstacleAndGoesOnWhenItIsGone)
{
  Simulation sim;
  sim.obstacles = {{12.0, 0.0}};
  ASSERT_EQ("", sim.navigator.start(to({{25.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runToStandstill(NavigatorState::HELD_UP)) << sim.text();
  EXPECT_EQ("obstacles", sim.output.limited_by);
  EXPECT_LT(sim.car.pose().x, 11.75 - 1.0 - 0.3);  // half the box, the vehicle's front, the margin
  EXPECT_GT(sim.car.pose().x, 7.0);
  sim.obstacles.clear();
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
}

TEST(Navigator, BrakesHardForWhatIsSuddenlyThere)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.car.speed() > 2.8; })) << sim.text();
  const double x = sim.car.pose().x + 4.5;
  sim.obstacles = {{x, 0.0}};
  double deceleration = 0.0;
  ASSERT_TRUE(sim.runUntil(
      [&]
      {
        deceleration = std::max(deceleration, sim.output.command.max_deceleration);
        return sim.car.speed() < 0.02;
      }))
      << sim.text();
  EXPECT_EQ(2.5, deceleration);
  EXPECT_LT(sim.car.pose().x + 1.0, x - 0.25);
}

TEST(Navigator, BrakesHardAlsoWhenItIsStoppingAnyway)
{
  for (const bool lost : {false, true})
  {
    Simulation sim;
    ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
    ASSERT_TRUE(sim.runUntil([&] { return sim.car.speed() > 2.8; })) << sim.text();
    const double x = sim.car.pose().x + 4.5;
    sim.obstacles = {{x, 0.0}};
    sim.localised = !lost;
    if (!lost)
    {
      sim.navigator.cancel("enough");
    }
    double deceleration = 0.0;
    ASSERT_TRUE(sim.runUntil(
        [&]
        {
          deceleration = std::max(deceleration, sim.output.command.max_deceleration);
          return sim.car.speed() < 0.02;
        }))
        << sim.text();
    EXPECT_EQ(2.5, deceleration) << lost;
    EXPECT_LT(sim.car.pose().x + 1.0, x - 0.25) << lost;
  }
}

TEST(Navigator, StopsWhenObstaclesFallSilent)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{30.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  sim.obstacles_heard = false;
  ASSERT_TRUE(sim.runToStandstill(NavigatorState::STOPPED)) << sim.text();
  EXPECT_NE(std::string::npos, sim.output.command.reason.find("no report of obstacles")) << sim.text();
  sim.obstacles_heard = true;
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
}

TEST(Navigator, DrivesWithoutObstaclesWhereTheyAreNotNeededButHeedsThem)
{
  NavigatorOptions options;
  options.need_obstacles = false;
  Simulation sim(options);
  sim.obstacles_heard = false;
  sim.runFor(2.0);
  ASSERT_EQ("", sim.navigator.start(to({{30.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  sim.obstacles_heard = true;
  sim.obstacles = {{20.0, 0.0}};
  ASSERT_TRUE(sim.runToStandstill(NavigatorState::HELD_UP)) << sim.text();
  EXPECT_LT(sim.car.pose().x, 18.5);
}

TEST(Navigator, ReportsFromTheFutureAreLeftOut)
{
  Simulation sim;
  const std::string problem = sim.navigator.setObstacles(sim.now_ns + 5'000'000'000, {}, sim.now_ns);
  EXPECT_NE(std::string::npos, problem.find("synchronise the clocks")) << problem;
  ObstacleBox box;
  box.position.x() = NaN;
  EXPECT_NE("", sim.navigator.setObstacles(sim.now_ns + 1, {box}, sim.now_ns));
}

TEST(Navigator, StopsOnLostLocalisationAndGoesOn)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{60.0, 0.0}}), sim.input()));
  const std::vector<std::pair<std::string, std::function<void(bool)>>> troubles = {
      {"no localisation: the lamp is out", [&](bool lost) { sim.localised = !lost; }},
      {"known to 2.5 m only, must be within max_position_deviation = 1.0 m",
       [&](bool lost) { sim.deviation = lost ? 2.5 : 0.1; }},
      {"covariance is not a number", [&](bool lost) { sim.deviation = lost ? NaN : 0.1; }},
      {"localisation jumped", [&](bool lost) { sim.shift.y() = lost ? 1.5 : 0.0; }},
  };
  for (const auto& [reason, make] : troubles)
  {
    ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
    make(true);
    ASSERT_TRUE(sim.runUntil([&] { return sim.output.state == NavigatorState::STOPPED; })) << sim.text();
    EXPECT_NE(std::string::npos, sim.output.command.reason.find(reason)) << sim.text();
    EXPECT_EQ(0.0, sim.output.command.speed);
    EXPECT_EQ(1.5, sim.output.command.max_deceleration);
    make(false);
  }
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
}

TEST(Navigator, FarFromThePathItWaitsForANewGoal)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  sim.shift.y() = 10.0;
  ASSERT_TRUE(sim.runUntil([&] { return sim.output.command.reason.find("send the goal again") != std::string::npos; }))
      << sim.text();
  const double x = sim.car.pose().x;
  sim.runFor(20.0);
  EXPECT_EQ(NavigatorState::STOPPED, sim.output.state);
  EXPECT_NEAR(x, sim.car.pose().x, 0.5);
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 10.0}}), sim.input()));
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
}

TEST(Navigator, SaysWhyTheVehicleDoesNotDriveAndGoesOn)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  sim.vehicle_problem = "emergency stop: the button";
  ASSERT_TRUE(sim.runToStandstill(NavigatorState::STOPPED)) << sim.text();
  EXPECT_EQ("vehicle: emergency stop: the button", sim.output.command.reason);
  sim.vehicle_problem.clear();
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  sim.vehicle_heard = false;
  ASSERT_TRUE(sim.runToStandstill(NavigatorState::STOPPED)) << sim.text();
  EXPECT_NE(std::string::npos, sim.output.command.reason.find("nothing heard of it for 0.5 s")) << sim.text();
  sim.vehicle_heard = true;
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
}

TEST(Navigator, CancelSlowsDownOnThePath)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.car.speed() > 2.0; })) << sim.text();
  const double x = sim.car.pose().x;
  sim.navigator.cancel("enough");
  sim.step();
  EXPECT_EQ(NavigatorState::STOPPING, sim.output.state);
  EXPECT_EQ(0.0, sim.output.command.max_deceleration);  // the usual one
  ASSERT_TRUE(sim.runToEnd(DriveEnd::CANCELLED)) << sim.text();
  EXPECT_EQ("enough", sim.output.command.reason);
  EXPECT_GT(sim.car.pose().x - x, 1.5);
  EXPECT_NEAR(0.0, sim.car.pose().y, 0.1);
  EXPECT_FALSE(sim.navigator.active());
  sim.navigator.cancel("again");  // nothing to cancel
  EXPECT_FALSE(sim.navigator.active());
}

TEST(Navigator, ANewGoalReplacesTheOldOneOnTheMove)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.car.speed() > 1.5; })) << sim.text();
  ASSERT_EQ("", sim.navigator.start(to({{20.0, 12.0}}), sim.input()));
  sim.step();
  EXPECT_TRUE(sim.output.path_changed);
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_LE(sim.distanceTo({20.0, 12.0}), 0.2);
}

TEST(Navigator, GivesUpWhereTheWayIsBlockedForLong)
{
  NavigatorOptions options;
  options.blocked_after_s = 10.0;
  Simulation sim(options);
  sim.obstacles = {{6.0, 0.0}};
  ASSERT_EQ("", sim.navigator.start(to({{20.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runToEnd(DriveEnd::FAILED)) << sim.text();
  EXPECT_EQ(0u, sim.output.command.reason.find("blocked at (3.7, 0.0) for 10 s: ")) << sim.text();
  EXPECT_NE(std::string::npos, sim.output.command.reason.find("something 0.5 m wide (obstacle 7) blocks the way"))
      << sim.text();
  EXPECT_EQ(0.0, sim.output.command.speed);
  sim.runFor(20.0);  // idle is no reason to give up
  EXPECT_EQ(DriveEnd::NONE, sim.output.end);
}

TEST(Navigator, FindsAWayRoundTheWallsOfTheMapWhereItMay)
{
  Simulation sim;
  const auto cells = std::make_shared<std::vector<int8_t>>(200 * 200, 0);
  for (size_t row = 60; row < 130; ++row)  // y from -8 to 6 at x = 10
  {
    (*cells)[row * 200 + 100] = 100;
  }
  sim.navigator.setMap({0, {-10.0, -20.0, 0.0}, 0.2, 200, 200, cells});
  NavigationGoal goal = to({{22.0, 0.0}});
  goal.find_way = true;
  ASSERT_EQ("", sim.navigator.start(goal, sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.car.pose().x > 10.0; })) << sim.text();
  EXPECT_GT(sim.car.pose().y, 6.7) << sim.text();
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  goal.waypoints[0].position = {10.1, 0.0};
  EXPECT_EQ("the map's grid has no free way to the point (10.1, 0.0) of the goal: is it on the grid, and free?",
            sim.navigator.start(goal, sim.input()));
}

TEST(Navigator, RefusesWhatCannotBeDrivenAndGoesOnWithTheGoalBefore)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{40.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  const auto refusal = [&sim](const NavigationGoal& goal) { return sim.navigator.start(goal, sim.input()); };
  EXPECT_EQ("the goal has no place and no waypoint: give one or more", refusal(NavigationGoal()));
  EXPECT_EQ(0u, refusal(to({{1.0, 0.0}, {NaN, 1.0}})).find("point 2 of the goal has a number that is none"));
  EXPECT_EQ(0u, refusal(to({{1.0, 0.0}}, NaN)).find("point 1 of the goal"));
  EXPECT_NE(std::string::npos, refusal(to({{90000.0, 0.0}})).find("must be at most max_route_length = 2000 m"));
  EXPECT_EQ(0u, refusal(to({{30.0, 0.0}, {20.0, 0.1}})).find("no route: waypoint 1"));
  NavigationGoal goal = to({{10.0, 0.0}});
  goal.max_speed = -1.0;
  EXPECT_EQ("max_speed = -1 m/s, must be 0 (no bound) or at least 0.1", refusal(goal));
  goal.max_speed = NaN;
  EXPECT_NE("", refusal(goal));
  goal.max_speed = 0.0;
  goal.loop = true;
  EXPECT_NE(std::string::npos, refusal(goal).find("must have 3"));
  sim.step();
  EXPECT_FALSE(sim.output.path_changed);
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_LE(sim.distanceTo({40.0, 0.0}), 0.2);
}

TEST(Navigator, WithoutAPoseItWaitsToPlan)
{
  Simulation sim;
  sim.localised = false;
  ASSERT_EQ("", sim.navigator.start(to({{10.0, 0.0}}), sim.input()));
  sim.runFor(5.0);
  EXPECT_EQ(NavigatorState::WAITING, sim.output.state);
  EXPECT_EQ("waits for a pose to plan from: the lamp is out", sim.output.command.reason);
  sim.localised = true;
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  sim.localised = false;
  ASSERT_EQ("", sim.navigator.start(to({{30.0, 0.0}, {20.0, 0.1}}), sim.input()));
  sim.localised = true;
  ASSERT_TRUE(sim.runToEnd(DriveEnd::FAILED)) << sim.text();
  EXPECT_EQ(0u, sim.output.command.reason.find("no route")) << sim.text();
  EXPECT_FALSE(sim.navigator.active());
}

TEST(Navigator, IsThereAlready)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{0.1, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_EQ(0.0, sim.car.travel());
}

TEST(Navigator, DrivesALoopRoundAndRound)
{
  Simulation sim;  // beside the loop
  NavigationGoal goal = to({{5.0, 6.0}, {25.0, 6.0}, {25.0, 26.0}, {5.0, 26.0}});
  goal.loop = true;
  ASSERT_EQ("", sim.navigator.start(goal, sim.input()));
  int rounds = 0;
  double progress = 0.0;
  ASSERT_TRUE(sim.runUntil(
      [&]
      {
        rounds += sim.navigator.path().closed() && sim.output.progress < 0.2 && progress > 0.8 ? 1 : 0;
        progress = sim.output.progress;
        return rounds == 2 || sim.output.end != DriveEnd::NONE;
      },
      400.0))
      << sim.text();
  EXPECT_EQ(DriveEnd::NONE, sim.output.end) << sim.text();
  EXPECT_GT(sim.car.travel(), 120.0);
  sim.navigator.cancel("enough");
  ASSERT_TRUE(sim.runToEnd(DriveEnd::CANCELLED)) << sim.text();
}

TEST(Navigator, SurvivesAClockThatGoesBack)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{30.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  sim.now_ns -= 500'000'000'000;
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_GE(sim.output.duration_s, 0.0);
}

TEST(Navigator, NumbersThatAreNoneStopIt)
{
  Simulation sim;
  ASSERT_EQ("", sim.navigator.start(to({{30.0, 0.0}}), sim.input()));
  ASSERT_TRUE(sim.runUntil([&] { return sim.drives(); })) << sim.text();
  NavigatorInput input = sim.input();
  input.now_ns += PERIOD_NS;
  input.speed = NaN;
  const NavigatorOutput output = sim.navigator.update(input);
  EXPECT_EQ(0.0, output.command.speed);
  EXPECT_EQ(NavigatorState::STOPPED, output.state);
  EXPECT_TRUE(std::isfinite(output.command.curvature));
  ASSERT_TRUE(sim.runToEnd(DriveEnd::ARRIVED)) << sim.text();
  EXPECT_TRUE(std::isfinite(sim.output.distance));
}

TEST(NavigatorOptions, NamesFieldValueAndBound)
{
  const auto refusal = [](const NavigatorOptions& options) -> std::string
  {
    try
    {
      const Navigator navigator(options);
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "";
  };
  NavigatorOptions options;
  EXPECT_EQ("", refusal(options));
  options.blocked_after_s = -1.0;
  EXPECT_EQ("blocked_after_s = -1, must be in [0, 86400]", refusal(options));
}

}  // namespace
}  // namespace pi_vehicle
