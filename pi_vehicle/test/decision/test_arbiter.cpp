#include "decision/arbiter.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "test_values.h"

namespace
{

using namespace pi_vehicle;

ArbiterOptions twoDrivers()
{
  ArbiterOptions options;
  options.sources = {{"remote", true, 100, 0.3, 1.5, false},
                     {"navigation", true, 10, 0.3, 3.0, false},
                     {"reaction", false, 0, 0.5, 3.0, false}};
  return options;
}

/// An arbiter at 50 Hz, with the bounds of its output checked in every step.
struct Bench
{
  Arbiter arbiter;
  int64_t now = 1000 * MS;
  ArbiterOutput output;
  double lowest_acceleration = 0.0;

  explicit Bench(const ArbiterOptions& options = twoDrivers()) : arbiter(options) { arbiter.update(now); }

  ArbiterAnswer say(const std::string& source, double speed, double curvature = 0.0, double deceleration = 0.0)
  {
    return arbiter.submit({speed, curvature, deceleration, source, source + " says so"}, now, now);
  }

  void step()
  {
    const ArbiterOutput before = output;
    now += 20 * MS;
    output = arbiter.update(now);
    const ArbiterOptions& o = arbiter.options();
    const double change = (output.command.speed - before.command.speed) / 0.02;
    EXPECT_LE(change, o.vehicle.acceleration + 1e-6);
    EXPECT_GE(change, -o.vehicle.emergency_deceleration - 1e-6);
    EXPECT_LE(std::abs(output.command.curvature), o.vehicle.curvature + 1e-9);
    EXPECT_LE(std::abs(output.command.curvature - before.command.curvature), o.vehicle.curvature_rate * 0.02 + 1e-9);
    EXPECT_LE(std::abs(output.acceleration - before.acceleration), 2.0 * o.emergency_jerk * 0.02 + 1e-6);
    lowest_acceleration = std::min(lowest_acceleration, output.acceleration);
  }

  /// Runs while `source` says the same at every step.
  void run(int steps, const std::string& source = "", double speed = 0.0, double curvature = 0.0)
  {
    for (int i = 0; i < steps; ++i)
    {
      if (!source.empty())
      {
        say(source, speed, curvature);
      }
      step();
    }
  }
};

TEST(Arbiter, DrivesWithJerkAndAccelerationBounded)
{
  Bench bench;
  double acceleration = 0.0;
  for (int i = 0; i < 300; ++i)
  {
    bench.say("navigation", 5.0);
    bench.step();
    EXPECT_LE(std::abs(bench.output.acceleration - acceleration), 4.0 * 0.02 * 2.0 + 1e-9);
    acceleration = bench.output.acceleration;
    EXPECT_LE(bench.output.command.speed, 3.0 + 1e-9) << "no overshoot";
  }
  EXPECT_NEAR(bench.output.command.speed, 3.0, 1e-6);
  EXPECT_EQ(bench.output.command.source, "navigation");
  EXPECT_EQ(bench.output.command.reason, "navigation says so");
  bench.run(400, "navigation", 0.0);
  EXPECT_EQ(bench.output.command.speed, 0.0);
  EXPECT_GE(bench.lowest_acceleration, -1.0 - 1e-9);
}

TEST(Arbiter, StopsWhenTheDriverDies)
{
  Bench bench;
  bench.run(200, "navigation", 2.0);
  ASSERT_NEAR(bench.output.command.speed, 2.0, 1e-6);
  bench.run(14);
  EXPECT_NEAR(bench.output.command.speed, 2.0, 1e-6) << "0.3 s are allowed";
  bench.run(1);
  EXPECT_EQ(bench.output.command.reason, "navigation fell silent");
  bench.run(150);
  EXPECT_EQ(bench.output.command.speed, 0.0);
  EXPECT_EQ(bench.output.command.reason, "nobody drives");
  bench.run(5, "navigation", 2.0);
  EXPECT_GT(bench.output.command.speed, 0.0);
}

TEST(Arbiter, HigherPriorityTakesOverAndGivesBackInOrder)
{
  Bench bench;
  bench.run(200, "navigation", 2.0);
  for (int i = 0; i < 200; ++i)
  {
    bench.say("navigation", 2.0);
    bench.say("remote", 5.0);
    bench.step();
  }
  EXPECT_EQ(bench.output.command.source, "remote");
  EXPECT_NEAR(bench.output.command.speed, 1.5, 1e-6) << "what the remote may ask for";
  EXPECT_TRUE(bench.arbiter.release("remote"));
  bench.run(1, "navigation", 2.0);
  EXPECT_EQ(bench.output.command.source, "navigation");
  EXPECT_FALSE(bench.arbiter.release("nobody"));
}

TEST(Arbiter, DeadManOfTheRemoteStopsBeforeTheNextMayDrive)
{
  Bench bench;
  bench.run(200, "remote", 1.5);
  bench.run(20, "navigation", 3.0);
  EXPECT_EQ(bench.output.command.reason, "remote fell silent");
  double least = 10.0;
  for (int i = 0; i < 150; ++i)
  {
    bench.run(1, "navigation", 3.0);
    least = std::min(least, bench.output.command.speed);
  }
  EXPECT_LT(least, 0.05);
  EXPECT_EQ(bench.output.command.source, "navigation");
}

TEST(Arbiter, LimitsBoundWhoeverDrivesAndDoNotDrive)
{
  Bench bench;
  bench.run(100, "reaction", 1.0);
  EXPECT_EQ(bench.output.command.speed, 0.0);
  EXPECT_EQ(bench.output.command.reason, "nobody drives");
  for (int i = 0; i < 200; ++i)
  {
    bench.say("navigation", 2.0);
    bench.say("reaction", 0.7);
    bench.step();
  }
  EXPECT_NEAR(bench.output.command.speed, 0.7, 1e-6);
  EXPECT_EQ(bench.output.command.source, "reaction");
  bench.run(200, "navigation", 2.0);
  EXPECT_NEAR(bench.output.command.speed, 2.0, 1e-6) << "one that is not required just ends";
}

TEST(Arbiter, SilenceOfARequiredSourceStops)
{
  ArbiterOptions options = twoDrivers();
  options.sources[2].required = true;
  Bench bench(options);
  bench.run(50, "navigation", 2.0);
  EXPECT_EQ(bench.output.command.speed, 0.0) << "has not spoken yet";
  EXPECT_EQ(bench.output.command.reason, "reaction is silent and required");
  for (int i = 0; i < 200; ++i)
  {
    bench.say("reaction", 10.0);
    bench.run(1, "navigation", 2.0);
  }
  EXPECT_NEAR(bench.output.command.speed, 2.0, 1e-6);
  bench.run(250, "navigation", 2.0);
  EXPECT_EQ(bench.output.command.speed, 0.0);
}

TEST(Arbiter, EmergencyStopLatchesAndIsReleasedOnlyAtStandstill)
{
  Bench bench;
  bench.run(250, "navigation", 3.0);
  bench.arbiter.emergencyStop("button");
  bench.arbiter.emergencyStop("again");
  int steps = 0;
  while (bench.output.command.speed > 0.0)
  {
    EXPECT_FALSE(bench.arbiter.releaseEmergencyStop() && bench.output.command.speed > 0.06);
    bench.arbiter.emergencyStop("button");
    bench.run(1, "navigation", 3.0);
    ASSERT_LT(++steps, 90) << "3 m/s at 2.5 m/s^2 take 1.2 s";
  }
  EXPECT_NEAR(bench.lowest_acceleration, -2.5, 0.05);
  EXPECT_TRUE(bench.output.emergency_stop);
  EXPECT_EQ(bench.output.command.reason, "emergency stop: button");
  bench.run(100, "navigation", 3.0);
  EXPECT_EQ(bench.output.command.speed, 0.0);
  bench.now += 20 * MS;
  bench.arbiter.update(bench.now, 0.4);
  EXPECT_FALSE(bench.arbiter.releaseEmergencyStop()) << "it still rolls";
  bench.run(1, "navigation", 3.0);
  EXPECT_TRUE(bench.arbiter.releaseEmergencyStop());
  bench.run(10, "navigation", 3.0);
  EXPECT_GT(bench.output.command.speed, 0.0);
}

TEST(Arbiter, ASourceMayAskForHarderBrakingButNotBeyondTheBound)
{
  Bench bench;
  bench.run(250, "navigation", 3.0);
  for (int i = 0; i < 60; ++i)
  {
    bench.say("navigation", 0.0, 0.0, 9.0);
    bench.step();
    EXPECT_EQ(bench.output.command.max_deceleration, 2.5);
  }
  EXPECT_NEAR(bench.lowest_acceleration, -2.5, 0.05);
}

TEST(Arbiter, AHarderStopCountsThoughTheDriverStopsGently)
{
  Bench bench;
  bench.run(300, "navigation", 3.0);
  for (int i = 0; i < 40; ++i)
  {
    bench.say("navigation", 0.0);
    bench.say("reaction", 0.0, 0.0, 2.5);
    bench.step();
  }
  EXPECT_NEAR(bench.lowest_acceleration, -2.5, 1e-6);
}

TEST(Arbiter, SaysWhoDrivesAndWhoHoldsBack)
{
  ArbiterOptions options = twoDrivers();
  options.sources[2].required = true;
  Bench bench(options);
  bench.step();
  EXPECT_TRUE(bench.output.missing);
  EXPECT_EQ(bench.output.driver, "");
  EXPECT_EQ(bench.output.limited_by, "arbiter");
  EXPECT_FALSE(bench.arbiter.sources()[1].heard);
  const auto run = [&bench](double limit)
  {
    bench.say("navigation", 2.0);
    bench.say("reaction", limit);
    bench.step();
  };
  run(1000.0);
  EXPECT_FALSE(bench.output.missing);
  EXPECT_EQ(bench.output.driver, "navigation");
  EXPECT_EQ(bench.output.limited_by, "");
  run(1.0);
  EXPECT_EQ(bench.output.driver, "navigation");
  EXPECT_EQ(bench.output.limited_by, "reaction");
  EXPECT_EQ(bench.arbiter.sources()[1].stamp_ns, bench.now - 20 * MS);
  bench.run(20, "navigation", 2.0);
  EXPECT_FALSE(bench.arbiter.sources()[0].alive);
  EXPECT_TRUE(bench.arbiter.sources()[1].alive);
  EXPECT_EQ(bench.arbiter.sources()[2].command.speed, 1.0);
}

TEST(Arbiter, BoundsCurvatureItsRateAndSpeedInBends)
{
  Bench bench;
  bench.run(300, "navigation", 3.0, 2.0);
  EXPECT_NEAR(bench.output.command.curvature, 0.45, 1e-9);
  EXPECT_LE(bench.output.command.speed, std::sqrt(1.5 / 0.45) + 1e-6);
  bench.run(1, "navigation", 3.0, -2.0);
  EXPECT_NEAR(bench.output.command.curvature, 0.45 - 0.016, 1e-9);
}

TEST(Arbiter, ReversesOnlyIfAllowedAndThroughStandstill)
{
  Bench bench;
  bench.run(100, "navigation", -1.0);
  EXPECT_EQ(bench.output.command.speed, 0.0);
  ArbiterOptions options = twoDrivers();
  options.max_reverse_speed = 0.5;
  Bench other(options);
  other.run(200, "navigation", 1.0);
  bool stood = false;
  for (int i = 0; i < 300; ++i)
  {
    other.run(1, "navigation", -1.0);
    stood = stood || other.output.command.speed == 0.0;
  }
  EXPECT_TRUE(stood);
  EXPECT_NEAR(other.output.command.speed, -0.5, 1e-6);
}

TEST(Arbiter, RefusesOddCommandsByName)
{
  Bench bench;
  EXPECT_EQ(bench.say("somebody", 1.0), ArbiterAnswer::UNKNOWN_SOURCE);
  EXPECT_EQ(bench.say("navigation", NaN), ArbiterAnswer::NOT_FINITE);
  EXPECT_EQ(bench.say("navigation", 1.0, std::numeric_limits<double>::infinity()), ArbiterAnswer::NOT_FINITE);
  EXPECT_EQ(bench.say("navigation", 1.0, 0.0, -1.0), ArbiterAnswer::NOT_FINITE);
  const DriveCommand command{1.0, 0.0, 0.0, "navigation", ""};
  EXPECT_EQ(bench.arbiter.submit(command, bench.now - 400 * MS, bench.now), ArbiterAnswer::TOO_OLD);
  EXPECT_EQ(bench.arbiter.submit(command, bench.now + 400 * MS, bench.now), ArbiterAnswer::FROM_FUTURE);
  EXPECT_EQ(bench.arbiter.submit(command, bench.now, bench.now), ArbiterAnswer::TAKEN);
  EXPECT_EQ(bench.arbiter.submit(command, bench.now - 10 * MS, bench.now), ArbiterAnswer::OUT_OF_ORDER);
}

TEST(Arbiter, NaNFromTheDriverEndsInAStopByTimeout)
{
  Bench bench;
  bench.run(200, "navigation", 2.0);
  for (int i = 0; i < 200; ++i)
  {
    bench.say("navigation", NaN);
    bench.step();
    ASSERT_TRUE(std::isfinite(bench.output.command.speed));
  }
  EXPECT_EQ(bench.output.command.speed, 0.0);
  EXPECT_EQ(bench.arbiter.update(bench.now + 20 * MS, NaN).command.speed, 0.0);
}

TEST(Arbiter, ClockJumpsKillAllSources)
{
  for (const int64_t jump : {-500000 * MS, 3600000 * MS})
  {
    Bench bench;
    bench.run(200, "navigation", 2.0);
    bench.now += jump;
    bench.step();
    EXPECT_EQ(bench.output.command.reason, "navigation fell silent") << jump;
    EXPECT_GT(bench.output.command.speed, 1.8) << "braked, not cut off";
    bench.run(150);
    EXPECT_EQ(bench.output.command.speed, 0.0);
    EXPECT_EQ(bench.say("navigation", 1.0), ArbiterAnswer::TAKEN);
  }
}

TEST(ArbiterOptions, FileAndCodeAreEqual)
{
  const ArbiterOptions file = ArbiterOptions::load(CONFIG_DIR "/arbiter.yaml", pi_node::MotionLimits());
  const ArbiterOptions code;
  std::vector<double> left;
  visitFields(file, [&left](const char*, double value) { left.push_back(value); });
  std::vector<double> right;
  visitFields(code, [&right](const char*, double value) { right.push_back(value); });
  EXPECT_EQ(left, right);
  ASSERT_EQ(file.sources.size(), 4U);
  EXPECT_TRUE(file.sources[3].required);
}

std::string errorOfSources(const std::string& yaml)
{
  return pi_node::test_support::messageOf<std::invalid_argument>(
      [&] { ArbiterOptions::parse(yaml, "arbiter.yaml", pi_node::MotionLimits()); });
}

TEST(ArbiterOptions, ErrorsNameSourceFieldValueAndBound)
{
  EXPECT_EQ(errorOfSources("{sources: []}"), "arbiter.yaml: sources is empty, must name at least one");
  EXPECT_EQ(errorOfSources("{sources: [{name: a, timeout: 0}]}"),
            "arbiter.yaml: sources/a/timeout = 0, must be in [0.02, 60]");
  EXPECT_EQ(errorOfSources("{sources: [{name: a}, {name: a}]}"),
            "arbiter.yaml: sources/a is there twice, must be once");
  EXPECT_EQ(errorOfSources("{sources: [{name: a}, {name: b}]}"),
            "arbiter.yaml: sources/b/priority = 0, must differ from that of a");
  EXPECT_EQ(errorOfSources("{limits: {jerk: fast}, sources: [{name: a}]}"),
            "arbiter.yaml: limits/jerk = \"fast\", must be of the right kind");
  EXPECT_EQ(errorOfSources("{sources: [{name: a, prio: 1}]}")
                .find("arbiter.yaml: sources/0/prio means nothing here; known are drives"),
            0U);
  EXPECT_EQ(errorOfSources("{sources: [{name: a, max_speed: 4}]}"),
            "arbiter.yaml: sources/a/max_speed = 4, must be in [0, 3] (vehicle/limits/speed)");
  EXPECT_EQ(errorOfSources("{limits: {max_lateral_acceleration: 2.5}, sources: [{name: a}]}"),
            "arbiter.yaml: limits/max_lateral_acceleration = 2.5, must be in [0.05, 2] "
            "(vehicle/limits/lateral_acceleration)");
  EXPECT_EQ(errorOfSources("[").find("arbiter.yaml: no YAML: "), 0U);
}

}  // namespace
