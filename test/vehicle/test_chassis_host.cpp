// The host's end, with a chassis on a line whose clock the test moves.

#include "chassis_line.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

namespace pi_vehicle::chassis
{
namespace
{

TEST(ChassisHost, DrivesAndKnowsTheChassis)
{
  ChassisLine line;
  EXPECT_EQ(HostMode::DISCONNECTED, line.state().mode);
  line.run(0.1);
  EXPECT_EQ(HostMode::READY, line.state().mode);
  ASSERT_TRUE(line.state().hello);
  EXPECT_NEAR(0.75, line.state().hello->wheelbase, 1e-9);
  line.drive(3.0, 1.0);
  const HostState state = line.state();
  EXPECT_EQ(HostMode::DRIVING, state.mode) << state.detail;
  EXPECT_TRUE(state.moving);
  EXPECT_NEAR(1.0, line.speed(), 0.01);
  EXPECT_GT(state.round_trip_s, 0.0);
  EXPECT_LE(state.round_trip_s, 0.021);
  EXPECT_EQ(0u, state.counters.lost_frames);
  EXPECT_EQ(0u, state.decoder.garbage_bytes);
}

TEST(ChassisHost, WheelOdometryIsTheTruth)
{
  ChassisLine line;
  line.drive(2.0, 1.0, 0.0);
  line.drive(6.0, 1.0, 0.3);
  line.drive(4.0, -0.5, -0.2);
  line.drive(3.0, 0.0);
  const WheelOdometry odometry = line.state().odometry;
  EXPECT_NEAR(line.model.pose().x, odometry.pose.x, 0.02);
  EXPECT_NEAR(line.model.pose().y, odometry.pose.y, 0.02);
  EXPECT_NEAR(line.model.pose().heading, odometry.pose.heading, 0.01);
  EXPECT_GT(odometry.distance, line.model.measurement().travel + 1.0);  // backwards counts
}

TEST(ChassisHost, LimitsOfBothEndsHold)
{
  HostOptions options;
  options.limits.speed = 1.5;
  Hello hello;
  hello.limits.curvature = 0.2;
  ChassisLine line(options, hello);
  line.drive(5.0, 99.0, 99.0);
  EXPECT_NEAR(1.5, line.speed(), 0.01);
  EXPECT_NEAR(0.2, line.setpoint.curvature, 1e-6);
  EXPECT_NE(std::string::npos, line.state().detail.find("cut to the limits"));
  EXPECT_GT(line.state().counters.limited_motions, 100u);
  EXPECT_EQ(0, line.state().status.faults & LIMITED);  // the host cut it before
}

TEST(ChassisHost, SpeedsUpNoFasterThanItsOwnLimit)
{
  HostOptions options;
  options.limits.acceleration = 0.25;
  ChassisLine line(options);
  line.run(0.1);
  line.drive(2.0, 2.0);
  EXPECT_NEAR(0.5, line.setpoint.speed, 0.02);
}

TEST(ChassisHost, SlowsDownByTheDecelerationOfTheMotion)
{
  for (const double deceleration : {0.5, 2.0})
  {
    ChassisLine line;
    line.drive(4.0, 2.0);
    const double start = line.setpoint.speed;
    line.drive(0.5, 0.0, 0.0, deceleration);
    EXPECT_NEAR(start - 0.5 * deceleration, line.setpoint.speed, 0.05 * deceleration);
  }
}

TEST(ChassisHost, StopsWhenMotionsCease)
{
  ChassisLine line;
  line.drive(4.0, 2.0);
  line.run(0.25);
  EXPECT_NEAR(2.0, line.setpoint.speed, 1e-6);  // 0.3 s are not over
  line.run(0.1 + 2.0 / 1.5 + 1.0);
  EXPECT_EQ(0.0, line.speed());
  EXPECT_EQ(HostMode::STOPPED_WATCHDOG, line.state().mode);
  EXPECT_EQ(Mode::READY, line.controller->mode());  // it was the host's watchdog
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::DRIVING, line.state().mode);
}

TEST(ChassisHost, CutWireToTheChassisStopsItByItsOwnWatchdog)
{
  ChassisLine line;
  line.drive(4.0, 2.0);
  line.to_chassis = false;
  line.drive(2.5, 2.0);
  EXPECT_EQ(0.0, line.speed());
  EXPECT_EQ(HostMode::STOPPED_WATCHDOG, line.state().mode);
}

TEST(ChassisHost, SilentChassisIsDisconnectedAndStopped)
{
  ChassisLine line;
  line.drive(4.0, 2.0);
  line.to_host = false;
  line.drive(3.0, 2.0);
  EXPECT_EQ(HostMode::DISCONNECTED, line.state().mode);
  EXPECT_NE(std::string::npos, line.state().detail.find("no status for")) << line.state().detail;
  EXPECT_EQ(0.0, line.speed());  // what is not heard is not driven
  EXPECT_EQ(1u, line.state().counters.status_timeouts);
  line.to_host = true;
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::DRIVING, line.state().mode);
}

TEST(ChassisHost, ChassisThatRestartsIsAskedAgainAndDrivesOn)
{
  ChassisLine line;
  line.drive(3.0, 1.0);
  const double x = line.state().odometry.pose.x;
  line.restartChassis();
  line.drive(2.0, 1.0);
  EXPECT_EQ(1u, line.state().counters.restarts);
  EXPECT_EQ(HostMode::DRIVING, line.state().mode);
  EXPECT_GT(line.state().odometry.pose.x, x);
  EXPECT_LT(line.state().odometry.pose.x, x + 2.1);
}

TEST(ChassisHost, EmergencyStopLatchesUntilReleased)
{
  ChassisLine line;
  line.drive(4.0, 2.0);
  line.host.emergencyStop("word stop");
  line.drive(2.0, 2.0);
  EXPECT_EQ(0.0, line.speed());
  EXPECT_EQ(HostMode::EMERGENCY_STOP, line.state().mode);
  EXPECT_NE(std::string::npos, line.state().detail.find("word stop"));
  EXPECT_EQ(Mode::EMERGENCY_STOP, line.controller->mode());
  line.host.release(line.now_ns);
  line.run(0.5);
  EXPECT_EQ(HostMode::READY, line.state().mode) << line.state().detail;
  EXPECT_EQ(0.0, line.speed());  // the motion of before is forgotten
  line.drive(2.0, 1.0);
  EXPECT_NEAR(1.0, line.speed(), 0.05);
}

TEST(ChassisHost, ReleaseRightAfterAnEmergencyStopIsNotLostOnStatusesOfBefore)
{
  ChassisLine line;
  line.drive(2.0, 1.0);
  line.host.emergencyStop("test");
  line.to_host = false;
  line.run(0.02);  // the stop goes out; the host hears nothing of it yet
  line.to_host = true;
  line.host.release(line.now_ns);
  Status before;
  before.command_seen = true;
  before.mode = Mode::DRIVING;
  before.uptime_ms = line.state().status.uptime_ms;
  before.echoed_sequence = line.state().status.echoed_sequence;
  const std::vector<uint8_t> late = encodeStatus(before, 0);
  line.host.onBytes(late.data(), late.size(), line.now_ns);
  line.run(0.2);
  EXPECT_NE(Mode::EMERGENCY_STOP, line.controller->mode());
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::DRIVING, line.state().mode) << line.state().detail;
}

TEST(ChassisHost, StopForgetsTheMotionAndLeavesTheLatch)
{
  ChassisLine line;
  line.drive(2.0, 1.0);
  line.host.emergencyStop("test");
  line.run(0.1);
  line.host.stop();
  line.run(2.0);
  EXPECT_EQ(0.0, line.speed());
  EXPECT_EQ(Mode::EMERGENCY_STOP, line.controller->mode());
}

TEST(ChassisHost, ButtonOnTheVehicleIsSaidAndReleased)
{
  ChassisLine line;
  line.drive(2.0, 1.0);
  line.model.setEmergencyButton(true);
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::EMERGENCY_STOP, line.state().mode);
  EXPECT_NE(std::string::npos, line.state().detail.find("button is pressed")) << line.state().detail;
  line.host.release(line.now_ns);
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::EMERGENCY_STOP, line.state().mode);
  line.model.setEmergencyButton(false);
  line.host.release(line.now_ns);
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::DRIVING, line.state().mode);
}

TEST(ChassisHost, StuckWheelsAreAFaultThatIsNamedAndReleased)
{
  ChassisLine line;
  line.model.setStuck(true);
  line.drive(3.0, 1.0);
  EXPECT_EQ(HostMode::FAULT, line.state().mode);
  EXPECT_NE(std::string::npos, line.state().detail.find("drive stuck")) << line.state().detail;
  line.model.setStuck(false);
  line.drive(1.0, 1.0);
  EXPECT_EQ(0.0, line.speed());
  line.host.release(line.now_ns);
  line.drive(2.0, 1.0);
  EXPECT_EQ(HostMode::DRIVING, line.state().mode);
}

TEST(ChassisHost, ClosedLineIsDisconnectedWithItsReason)
{
  ChassisLine line;
  line.drive(1.0, 1.0);
  line.host.onLineClosed("gone");
  EXPECT_EQ(HostMode::DISCONNECTED, line.state().mode);
  EXPECT_EQ("gone", line.state().detail);
  EXPECT_TRUE(line.host.poll(line.now_ns).empty());
}

TEST(ChassisHost, MotionsThatAreNoNumbersAreRefused)
{
  ChassisLine line;
  Motion motion;
  motion.speed = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(line.host.setMotion(motion, line.now_ns));
  motion.speed = 1.0;
  motion.curvature = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(line.host.setMotion(motion, line.now_ns));
  EXPECT_EQ(2u, line.state().counters.refused_motions);
  line.run(1.0);
  EXPECT_EQ(0.0, line.speed());
}

TEST(ChassisHost, GarbageBetweenFramesIsCountedAndNothingIsLost)
{
  ChassisLine line;
  std::mt19937 random(3);
  line.run(5.0,
           [&]
           {
             Motion motion;
             motion.speed = 1.0;
             line.host.setMotion(motion, line.now_ns);
             std::vector<uint8_t> garbage(random() % 20);
             for (uint8_t& byte : garbage)
             {
               byte = static_cast<uint8_t>(random());
             }
             line.host.onBytes(garbage.data(), garbage.size(), line.now_ns);
           });
  EXPECT_EQ(HostMode::DRIVING, line.state().mode) << line.state().detail;
  EXPECT_NEAR(1.0, line.speed(), 0.01);
  EXPECT_GT(line.state().decoder.garbage_bytes, 1000u);
}

TEST(HostOptions, WrongOnesAreNamed)
{
  HostOptions options;
  options.command_period_s = 0.1;  // slower than 20 Hz
  try
  {
    options.validate();
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ("command_period_s = 0.1, must be in [0.002, 0.05]", error.what());
  }
}

}  // namespace
}  // namespace pi_vehicle::chassis
