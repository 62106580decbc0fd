#include "chassis/twist_base.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace
{

using namespace pi_vehicle;
using namespace pi_vehicle::chassis;

constexpr int64_t PERIOD_NS = 50'000'000;
constexpr double NAN_VALUE = std::numeric_limits<double>::quiet_NaN();

/// A base that does at once what it is told, with odometry.
struct Drive
{
  TwistBase base;
  Pose2 pose;
  Twist twist;
  int64_t now_ns = 1'000'000'000;
  double hardest = 0.0;  ///< change of the speed [m/s^2]
  bool odometry = true;

  explicit Drive(const TwistBaseOptions& options = TwistBaseOptions()) : base(options) {}

  /// @param motion  sent before each step; null: none.
  void run(double time_s, const Motion* motion)
  {
    const int64_t end_ns = now_ns + static_cast<int64_t>(1e9 * time_s);
    for (; now_ns < end_ns; now_ns += PERIOD_NS)
    {
      if (odometry)
      {
        EXPECT_TRUE(base.onOdometry(pose, twist.linear, twist.angular, now_ns));
      }
      if (motion != nullptr)
      {
        EXPECT_TRUE(base.setMotion(*motion, now_ns));
      }
      const double before = twist.linear;
      twist = base.poll(now_ns);
      const double dt = 1e-9 * PERIOD_NS;
      hardest = std::max(hardest, (before - twist.linear) / dt);
      pose = pose.moved(twist.linear * dt, twist.linear > 0.0 ? twist.angular / twist.linear : 0.0);
    }
  }
  HostState state() const { return base.state(now_ns - PERIOD_NS); }
};

TEST(TwistBase, RampsUpToTheMotionAndTurns)
{
  Drive drive;
  EXPECT_EQ(HostMode::DISCONNECTED, drive.state().mode);
  const Motion motion{2.0, 0.2, 0.0};
  drive.run(1.0, &motion);
  EXPECT_NEAR(1.0, drive.twist.linear, 0.1) << "1 m/s^2";
  drive.run(2.0, &motion);
  EXPECT_DOUBLE_EQ(2.0, drive.twist.linear);
  EXPECT_NEAR(0.4, drive.twist.angular, 1e-9);
  EXPECT_EQ(HostMode::DRIVING, drive.state().mode);
  EXPECT_NEAR(0.2, drive.state().status.curvature, 1e-6);
  EXPECT_NEAR(4.0, drive.state().odometry.distance, 0.3);
}

TEST(TwistBase, CutsMotionsToItsLimits)
{
  TwistBaseOptions options;
  options.limits.speed = 1.5;
  options.limits.lateral_acceleration = 0.45;
  Drive drive(options);
  const Motion motion{3.0, 0.9, 0.0};
  drive.run(4.0, &motion);
  EXPECT_NEAR(1.0, drive.twist.linear, 1e-9) << "sqrt(0.45 / 0.45)";
  EXPECT_NEAR(0.45, drive.twist.angular, 1e-9);
  EXPECT_EQ("motion cut to the limits", drive.state().detail);
}

TEST(TwistBase, GivesTheSteeringAngleToThoseWhoWantIt)
{
  TwistBaseOptions options;
  options.steering_angle = true;
  options.wheelbase = 2.0;
  Drive drive(options);
  const Motion motion{0.0, 0.3, 0.0};
  drive.run(0.2, &motion);
  EXPECT_NEAR(std::atan(0.6), drive.twist.angular, 1e-9) << "also at a stand";
}

TEST(TwistBase, StopsWhenMotionsCease)
{
  Drive drive;
  const Motion motion{2.0, 0.0, 0.0};
  drive.run(3.0, &motion);
  drive.hardest = 0.0;
  drive.run(3.0, nullptr);
  EXPECT_EQ(0.0, drive.twist.linear);
  EXPECT_NEAR(1.5, drive.hardest, 1e-6);
  EXPECT_EQ(HostMode::STOPPED_WATCHDOG, drive.state().mode);
  drive.run(0.5, &motion);
  EXPECT_GT(drive.twist.linear, 0.3);
}

TEST(TwistBase, LatchesAnEmergencyStop)
{
  Drive drive;
  const Motion motion{2.0, 0.0, 0.0};
  drive.run(3.0, &motion);
  drive.base.emergencyStop("asked by a test");
  drive.hardest = 0.0;
  drive.run(3.0, &motion);
  EXPECT_EQ(0.0, drive.twist.linear);
  EXPECT_NEAR(2.5, drive.hardest, 1e-6);
  EXPECT_EQ(HostMode::EMERGENCY_STOP, drive.state().mode);
  EXPECT_EQ("asked by a test; stays until it is released", drive.state().detail);
  drive.base.release();
  drive.run(0.2, nullptr);
  EXPECT_EQ(0.0, drive.twist.linear) << "until a new motion";
  drive.run(0.5, &motion);
  EXPECT_GT(drive.twist.linear, 0.3);
}

TEST(TwistBase, StandsWithoutOdometry)
{
  Drive drive;
  const Motion motion{2.0, 0.0, 0.0};
  drive.run(3.0, &motion);
  drive.odometry = false;
  drive.run(0.6, &motion);
  EXPECT_EQ(0.0, drive.twist.linear);
  EXPECT_EQ(HostMode::DISCONNECTED, drive.state().mode);
  EXPECT_NE(std::string::npos, drive.state().detail.find("is the chassis unplugged, or its driver not running?"));
}

TEST(TwistBase, TakesAJumpOfTheOdometryForARestart)
{
  Drive drive;
  const Motion motion{1.0, 0.0, 0.0};
  drive.run(3.0, &motion);
  const double before = drive.state().odometry.pose.x;
  drive.pose = Pose2();  // the base began anew
  drive.run(1.0, &motion);
  EXPECT_NEAR(before + 1.0, drive.state().odometry.pose.x, 0.15);
  EXPECT_EQ(1u, drive.state().counters.restarts);
}

TEST(TwistBase, RefusesWhatIsNotFinite)
{
  TwistBase base{TwistBaseOptions()};
  EXPECT_FALSE(base.onOdometry({NAN_VALUE, 0.0, 0.0}, 0.0, 0.0, 1));
  EXPECT_FALSE(base.onOdometry(Pose2(), 0.0, NAN_VALUE, 1));
  EXPECT_FALSE(base.setMotion({NAN_VALUE, 0.0, 0.0}, 1));
  EXPECT_EQ(1u, base.state(1).counters.refused_motions);
  EXPECT_EQ(2u, base.state(1).counters.refused_frames);
}

TEST(TwistBaseOptions, NamesFieldValueAndBound)
{
  TwistBaseOptions options;
  options.wheelbase = 0.0;
  EXPECT_NO_THROW(options.validate());
  options.steering_angle = true;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = TwistBaseOptions();
  options.limits.speed = -1.0;
  try
  {
    options.validate();
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_EQ(0u, std::string(error.what()).find("limits/speed = -1")) << error.what();
  }
}

}  // namespace
