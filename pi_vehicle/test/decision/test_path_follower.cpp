#include "decision/path_follower.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <stdexcept>
#include <string>

#include "test_values.h"

namespace
{

using namespace pi_vehicle;

/// The example car: bicycle model (rear axle), dead time, first-order lag of steering and drive, limited rates.
struct Car
{
  static constexpr double WHEELBASE = 1.2;
  static constexpr double MAX_STEERING = 0.5;
  static constexpr double STEERING_RATE = 0.8;  // [rad/s]
  static constexpr double STEERING_LAG = 0.12;  // [s]
  static constexpr double DRIVE_LAG = 0.2;      // [s]
  static constexpr int DEAD_STEPS = 5;          // of 10 ms

  Pose2 pose;
  double speed = 0.0;
  double steering = 0.0;
  std::deque<DriveCommand> waiting;

  double curvature() const { return std::tan(steering) / WHEELBASE; }

  void step(const DriveCommand& command, double dt)
  {
    waiting.push_back(command);
    if (waiting.size() <= DEAD_STEPS)
    {
      return;
    }
    const DriveCommand now = waiting.front();
    waiting.pop_front();
    const double braking = now.max_deceleration > 0.0 ? now.max_deceleration : 1.0;
    speed += std::clamp((now.speed - speed) / DRIVE_LAG, -braking, 1.5) * dt;
    const double wanted = std::clamp(std::atan(now.curvature * WHEELBASE), -MAX_STEERING, MAX_STEERING);
    steering += std::clamp((wanted - steering) / STEERING_LAG, -STEERING_RATE, STEERING_RATE) * dt;
    pose = pose.moved(speed * dt, curvature());
  }
};

struct Drive
{
  double max_cross_track = 0.0;  // true, after `settled_after`
  double max_speed = 0.0;
  double max_curvature_step = 0.0;
  double time = 0.0;
  FollowerOutput last;
  Car car;
};

/// Car and follower in a loop of 100 Hz; poses at 20 Hz, 60 ms old.
class Simulation
{
public:
  explicit Simulation(const Path& path, const Pose2& start, const PathFollowerOptions& options = PathFollowerOptions())
    : follower(options), path_(path)
  {
    follower.setPath(path);
    car.pose = start;
  }

  /// One step of 10 ms.
  FollowerOutput step()
  {
    history_.push_back({now_ns, car.pose});
    if (history_.size() > 7)
    {
      history_.pop_front();
    }
    if (now_ns % (50 * MS) == 0 && localised)
    {
      measured_ = disturbance(history_.front().second);
      stamp_ns_ = history_.front().first;
    }
    FollowerInput input;
    input.now_ns = now_ns;
    input.pose_stamp_ns = stamp_ns_;
    input.pose = measured_;
    input.speed = car.speed;
    input.curvature = car.curvature();
    output = follower.update(input);
    car.step(output.command, 0.01);
    now_ns += 10 * MS;
    return output;
  }

  double crossTrack()
  {
    const PathProjection projection = path_.project(car.pose, s_ - 1.0, s_ + 2.0);
    s_ = projection.s;
    return projection.cross_track;
  }

  Drive run(double time_s, double settled_after_s = 0.0)
  {
    Drive drive;
    double curvature = output.command.curvature;
    for (double t = 0.0; t < time_s && output.state != FollowerState::DONE; t += 0.01)
    {
      step();
      const double error = std::abs(crossTrack());
      if (t >= settled_after_s)
      {
        drive.max_cross_track = std::max(drive.max_cross_track, error);
      }
      drive.max_speed = std::max(drive.max_speed, car.speed);
      drive.max_curvature_step = std::max(drive.max_curvature_step, std::abs(output.command.curvature - curvature));
      curvature = output.command.curvature;
      drive.time = t;
    }
    drive.last = output;
    drive.car = car;
    return drive;
  }

  PathFollower follower;
  Car car;
  int64_t now_ns = 1000 * MS;
  bool localised = true;
  std::function<Pose2(const Pose2&)> disturbance = [](const Pose2& pose) { return pose; };
  FollowerOutput output;

private:
  Path path_;
  double s_ = 0.0;
  std::deque<std::pair<int64_t, Pose2>> history_;
  Pose2 measured_;
  int64_t stamp_ns_ = 0;
};

Path straight(double length)
{
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i <= static_cast<int>(length * 10.0); ++i)
  {
    points.emplace_back(0.1 * i, 0.0);
  }
  return Path(points);
}

/// Straight, a left arc of 90 degrees, straight.
Path corner(double before, double radius, double after)
{
  std::vector<Eigen::Vector2d> points;
  Pose2 pose;
  const double arc = 0.5 * M_PI * radius;
  const double length = before + arc + after;
  for (double s = 0.0; s <= length; s += 0.05)
  {
    points.push_back(pose.position());
    pose = pose.moved(0.05, s >= before && s < before + arc ? 1.0 / radius : 0.0);
  }
  return Path(points);
}

/// Lemniscate of Gerono, closed, about 2 * 8 m wide.
Path figureOfEight(double size)
{
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 600; ++i)
  {
    const double t = 2.0 * M_PI * i / 600.0;
    points.emplace_back(size * std::sin(t), size * std::sin(t) * std::cos(t));
  }
  return Path(points, true);
}

double goalDistance(const Drive& drive, const Path& path)
{
  return (path.points().back().pose().position() - drive.car.pose.position()).norm();
}

TEST(Path, KnowsTangentCurvatureAndLengthOfACircle)
{
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 200; ++i)
  {
    points.emplace_back(5.0 * std::cos(2.0 * M_PI * i / 200), 5.0 * std::sin(2.0 * M_PI * i / 200));
  }
  const Path path(points, true);
  EXPECT_NEAR(path.length(), 10.0 * M_PI, 0.01);
  EXPECT_NEAR(path.at(-1.0).curvature, 0.2, 1e-3);
  EXPECT_NEAR(std::abs(path.at(path.length() / 4.0).heading), M_PI, 0.02);
  EXPECT_NEAR(path.at(3.0 * path.length() + 1.0).s, 1.0, 1e-9);
  const PathProjection projection = path.project({6.0, 0.0, 0.5 * M_PI});
  EXPECT_NEAR(projection.cross_track, -1.0, 1e-3);
  EXPECT_NEAR(projection.heading_error, 0.0, 0.02);
}

TEST(Path, RefusesTooFewOddAndRepeatedPoints)
{
  EXPECT_THROW(Path({{0.0, 0.0}}), std::invalid_argument);
  EXPECT_THROW(Path({{0.0, 0.0}, {1.0, 0.0}}, true), std::invalid_argument);
  EXPECT_THROW(Path({{0.0, 0.0}, {NaN, 0.0}}), std::invalid_argument);
  EXPECT_THROW(Path({{0.0, 0.0}, {1.0, 0.0}, {1.0, 0.0}}), std::invalid_argument);
}

TEST(Path, ProjectsOntoThePartAskedForWhereItCrossesItself)
{
  const Path path = figureOfEight(8.0);
  const double half = path.length() / 2.0;
  EXPECT_NEAR(std::remainder(path.project({0.0, 0.0, 0.0}, -2.0, 2.0).s, path.length()), 0.0, 0.1);
  EXPECT_NEAR(path.project({0.0, 0.0, 0.0}, half - 2.0, half + 2.0).s, half, 0.1);
  // As a whole, the heading tells which of the two it is.
  EXPECT_NEAR(path.project({0.0, 0.0, 0.75 * M_PI}, 1.0).s, half, 0.2);
}

TEST(PathFollower, KeepsToAStraightAtFullSpeedAndStopsAtTheGoal)
{
  const Path path = straight(30.0);
  Simulation simulation(path, {0.0, 0.0, 0.0});
  const Drive drive = simulation.run(40.0);
  EXPECT_EQ(drive.last.state, FollowerState::DONE);
  EXPECT_LT(drive.max_cross_track, 0.01);
  EXPECT_GT(drive.max_speed, 2.9);
  EXPECT_LT(drive.max_speed, 3.05);
  EXPECT_LT(goalDistance(drive, path), 0.2);
  EXPECT_EQ(drive.last.progress, 1.0);
  EXPECT_EQ(drive.last.command.speed, 0.0);
  RecordProperty("goal_mm", static_cast<int>(1000 * goalDistance(drive, path)));
}

TEST(PathFollower, TakesACornerOfThreeMetresRadius)
{
  const Path path = corner(10.0, 3.0, 10.0);
  Simulation simulation(path, {0.0, 0.0, 0.0});
  const Drive drive = simulation.run(60.0);
  EXPECT_EQ(drive.last.state, FollowerState::DONE);
  EXPECT_LT(drive.max_cross_track, 0.2);
  EXPECT_LT(goalDistance(drive, path), 0.2);
  RecordProperty("cross_track_mm", static_cast<int>(1000 * drive.max_cross_track));
}

TEST(PathFollower, DrivesRoundAFigureOfEight)
{
  const Path path = figureOfEight(8.0);
  Simulation simulation(path, path.at(0.0).pose());
  const Drive drive = simulation.run(60.0);
  EXPECT_EQ(drive.last.state, FollowerState::FOLLOWING);
  EXPECT_LT(drive.max_cross_track, 0.25);
  EXPECT_GT(drive.max_speed, 1.5);
  RecordProperty("cross_track_mm", static_cast<int>(1000 * drive.max_cross_track));
}

TEST(PathFollower, RejoinsFromTwoMetresBeside)
{
  const Path path = straight(30.0);
  for (const double side : {2.0, -2.0})
  {
    Simulation simulation(path, {0.0, side, 0.0});
    double overshoot = 0.0;
    for (int i = 0; i < 1000; ++i)
    {
      simulation.step();
      overshoot = std::max(overshoot, -std::copysign(1.0, side) * simulation.crossTrack());
    }
    EXPECT_LT(overshoot, 0.15);
    const Drive drive = simulation.run(60.0);
    EXPECT_LT(drive.max_cross_track, 0.1) << "10 s later";
    EXPECT_EQ(drive.last.state, FollowerState::DONE);
    EXPECT_LT(goalDistance(drive, path), 0.2);
  }
}

TEST(PathFollower, TurnsRoundIfItFacesTheWrongWay)
{
  PathFollowerOptions options;
  options.max_offset = 6.0;  // the turning circle is 4.5 m wide
  Simulation simulation(straight(40.0), {20.0, 0.0, M_PI - 0.1}, options);
  const Drive drive = simulation.run(90.0, 30.0);
  EXPECT_EQ(drive.last.state, FollowerState::DONE);
  EXPECT_LT(drive.max_cross_track, 0.1);
}

TEST(PathFollower, WorksWithNoisyPoses)
{
  const Path path = corner(10.0, 3.0, 10.0);
  Simulation simulation(path, {0.0, 0.0, 0.0});
  unsigned state = 1;
  const auto noise = [&state](double sigma)
  {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i)
    {
      state = state * 1664525U + 1013904223U;
      sum += static_cast<double>(state) / 4294967296.0;
    }
    return sigma * sum;
  };
  simulation.disturbance = [&noise](const Pose2& p) {
    return Pose2{p.x + noise(0.02), p.y + noise(0.02), p.heading + noise(0.01)};
  };
  const Drive drive = simulation.run(60.0);
  EXPECT_EQ(drive.last.state, FollowerState::DONE);
  EXPECT_LT(drive.max_cross_track, 0.25);
}

TEST(PathFollower, StopsWhenLocalisationIsStaleAndGoesOnWhenItIsBack)
{
  Simulation simulation(straight(40.0), {0.0, 0.0, 0.0});
  simulation.run(5.0);
  ASSERT_GT(simulation.car.speed, 2.0);
  simulation.localised = false;
  int steps = 0;
  while (simulation.step().state == FollowerState::FOLLOWING)
  {
    ASSERT_LT(++steps, 100);
  }
  EXPECT_EQ(simulation.output.stop, FollowerStop::STALE_LOCALISATION);
  EXPECT_NE(simulation.output.command.reason.find("must be within 0.30 s"), std::string::npos);
  EXPECT_LE(steps, 31);
  simulation.run(4.0);
  EXPECT_LT(simulation.car.speed, 0.02);
  simulation.localised = true;
  simulation.disturbance = [](const Pose2& pose) { return pose; };
  const Drive drive = simulation.run(60.0);
  EXPECT_EQ(drive.last.state, FollowerState::DONE);
}

TEST(PathFollower, StopsAtOnceWhenLocalisationIsLost)
{
  PathFollower follower;
  follower.setPath(straight(10.0));
  FollowerInput input;
  input.pose = Pose2();
  EXPECT_EQ(follower.update(input).state, FollowerState::FOLLOWING);
  input.pose.reset();
  input.now_ns = 10 * MS;
  const FollowerOutput output = follower.update(input);
  EXPECT_EQ(output.stop, FollowerStop::NO_LOCALISATION);
  EXPECT_EQ(output.command.speed, 0.0);
  EXPECT_EQ(output.command.max_deceleration, PathFollowerOptions().stop_deceleration);
  EXPECT_TRUE(follower.wayAhead(5.0, 0.1).empty());
}

TEST(PathFollower, TakesASmallJumpOverSmoothly)
{
  const Path path = straight(60.0);
  Simulation simulation(path, {0.0, 0.0, 0.0});
  simulation.run(5.0);
  simulation.disturbance = [](const Pose2& p) { return Pose2{p.x, p.y + 0.5, p.heading}; };
  double largest = 0.0;
  for (int i = 0; i < 50; ++i)
  {
    const FollowerOutput output = simulation.step();
    ASSERT_EQ(output.state, FollowerState::FOLLOWING);
    largest = std::max(largest, std::abs(output.command.curvature));
  }
  EXPECT_LT(largest, 0.15) << "a step of 0.5 m at once would ask for 0.2 or more";
  simulation.run(8.0);
  EXPECT_NEAR(simulation.car.pose.y, -0.5, 0.1) << "at the end it drives where localisation says the path is";
}

TEST(PathFollower, StopsAtALargeJumpAndGoesOnWhenPosesAgreeAgain)
{
  Simulation simulation(straight(60.0), {0.0, 0.0, 0.0});
  simulation.run(5.0);
  simulation.disturbance = [](const Pose2& p) { return Pose2{p.x, p.y + 1.5, p.heading}; };
  simulation.run(0.06);
  EXPECT_EQ(simulation.output.stop, FollowerStop::LOCALISATION_JUMPED);
  simulation.run(1.5);
  EXPECT_EQ(simulation.output.stop, FollowerStop::LOCALISATION_JUMPED);
  simulation.run(1.0);
  EXPECT_EQ(simulation.output.state, FollowerState::FOLLOWING);

  PathFollowerOptions options;
  options.jump_settle_time = 0.0;
  Simulation manual(straight(60.0), {0.0, 0.0, 0.0}, options);
  manual.run(5.0);
  manual.disturbance = [](const Pose2& p) { return Pose2{p.x, p.y, p.heading + 0.5}; };
  manual.run(10.0);
  EXPECT_EQ(manual.output.stop, FollowerStop::LOCALISATION_JUMPED);
  manual.follower.resume();
  EXPECT_EQ(manual.step().state, FollowerState::FOLLOWING);
}

TEST(PathFollower, StopsFarOffThePathAndOnNumbersThatAreNone)
{
  PathFollower follower;
  FollowerInput input;
  input.pose = Pose2{0.0, 0.0, 0.0};
  EXPECT_EQ(follower.update(input).state, FollowerState::IDLE);
  follower.setPath(straight(10.0));
  input.pose = Pose2{5.0, 0.2, NaN};
  EXPECT_EQ(follower.update(input).stop, FollowerStop::BAD_INPUT);
  input.pose = Pose2{0.0, 0.0, 0.0};
  input.speed = NaN;
  EXPECT_EQ(follower.update(input).stop, FollowerStop::BAD_INPUT);
  input.speed = 0.0;
  PathFollower other;
  other.setPath(straight(10.0));
  input.pose = Pose2{5.0, 4.5, 0.0};
  const FollowerOutput output = other.update(input);
  EXPECT_EQ(output.stop, FollowerStop::OFF_PATH);
  EXPECT_EQ(output.command.reason, "4.5 m off the path, must be within 4.0 m: plan again");
}

TEST(PathFollower, DoesNotWindUpWhileSomebodyHoldsTheVehicle)
{
  PathFollower follower;
  follower.setPath(straight(20.0));
  FollowerInput input;
  input.pose = Pose2();
  for (int i = 0; i < 1000; ++i)
  {
    input.now_ns = input.pose_stamp_ns = i * 20 * MS;
    EXPECT_LE(follower.update(input).command.speed, 0.6);
  }
}

TEST(PathFollower, StartsAnewAfterTheClockWentBack)
{
  PathFollower follower;
  follower.setPath(straight(20.0));
  FollowerInput input;
  input.now_ns = input.pose_stamp_ns = 5000000 * MS;
  input.pose = Pose2();
  follower.update(input);
  input.now_ns = input.pose_stamp_ns = 1000 * MS;
  input.pose = Pose2{10.0, 0.0, 0.0};  // no jump: there is nothing to compare it with
  EXPECT_EQ(follower.update(input).state, FollowerState::FOLLOWING);
}

TEST(PathFollower, TellsTheWayAheadInBaseLink)
{
  PathFollower follower;
  follower.setPath(corner(2.0, 3.0, 10.0));
  FollowerInput input;
  input.pose = Pose2{1.0, 0.0, 0.0};
  follower.update(input);
  const std::vector<Pose2> way = follower.wayAhead(8.0, 0.1);
  ASSERT_EQ(way.size(), 81U);
  EXPECT_EQ(way.front().x, 0.0);
  EXPECT_NEAR(way.back().heading, 0.5 * M_PI, 0.1);
  const Pose2 end = *input.pose * way.back();
  EXPECT_LT(std::abs(follower.path().project(end).cross_track), 0.2);
}

TEST(PathFollowerOptions, NamesFieldValueAndBound)
{
  PathFollowerOptions options;
  options.validate();
  options.look_ahead_min = 0.0;
  try
  {
    PathFollower follower(options);
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "follower/look_ahead_min = 0, must be in [0.1, 10]");
  }
}

}  // namespace
