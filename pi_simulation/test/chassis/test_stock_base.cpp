// A base that takes velocities and tells odometry, with time as the test gives it.

#include "chassis/simulated_chassis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace pi_simulation
{

using namespace pi_vehicle::chassis;

namespace
{

constexpr int64_t STEP_NS = 5'000'000;
constexpr double NAN_VALUE = std::numeric_limits<double>::quiet_NaN();

SimulationOptions baseOf(pi_node::VehicleKind kind)
{
  pi_node::VehicleDescription vehicle;
  vehicle.kind = kind;
  vehicle.wheelbase = kind == pi_node::VehicleKind::DIFFERENTIAL ? 0.0 : vehicle.wheelbase;
  vehicle.limits.curvature = 1.0;
  SimulationOptions options;
  options.base = Base::TWIST;
  options.setVehicle(vehicle);
  return options;
}

class StockBaseDrive
{
public:
  explicit StockBaseDrive(pi_node::VehicleKind kind = pi_node::VehicleKind::DIFFERENTIAL)
    : chassis(baseOf(kind), now_ns)
  {
  }
  void step(double seconds)
  {
    for (const int64_t end_ns = now_ns + std::llround(1e9 * seconds); now_ns < end_ns;)
    {
      now_ns += STEP_NS;
      chassis.step(now_ns);
      fastest_change = std::max(fastest_change, std::abs(speed() - last_speed_) / (1e-9 * STEP_NS));
      last_speed_ = speed();
    }
  }
  /// Twists at 20 Hz.
  void drive(double seconds, double linear, double angular)
  {
    for (int64_t i = std::lround(20.0 * seconds); i > 0; --i)
    {
      EXPECT_TRUE(chassis.onTwist(linear, angular, now_ns));
      step(0.05);
    }
  }
  double speed() const { return chassis.model().measurement().speed; }

  int64_t now_ns = 1'000'000'000;
  SimulatedChassis chassis;
  double fastest_change = 0.0;  ///< [m/s^2]

private:
  double last_speed_ = 0.0;
};

TEST(StockBase, TurnsOnTheSpot)
{
  StockBaseDrive base;
  base.drive(2.0, 0.0, 0.5);
  base.drive(2.0, 0.0, 0.0);
  const pi_vehicle::Pose2& pose = base.chassis.model().pose();
  EXPECT_NEAR(1.0, pose.heading, 1e-3);
  EXPECT_EQ(0.0, pose.position().norm());
  EXPECT_NEAR(1.01, base.chassis.teller()->odometry().heading, 1e-3);
  EXPECT_EQ(Mode::READY, base.chassis.mode());
}

TEST(StockBase, DrivesTheArcWithinItsLimitsAndTellsItWithSmallErrors)
{
  for (const auto kind : {pi_node::VehicleKind::DIFFERENTIAL, pi_node::VehicleKind::ACKERMANN})
  {
    StockBaseDrive base(kind);
    base.drive(10.0, 9.0, 0.0);
    EXPECT_NEAR(3.0, base.speed(), 1e-3);
    EXPECT_LT(base.fastest_change, 1.05) << "acceleration of the vehicle";
    const pi_vehicle::Pose2 before = base.chassis.model().pose();
    const double told = base.chassis.teller()->odometry().x;
    EXPECT_NEAR(1.005, told / before.x, 1e-3) << "of the step before";
    base.drive(4.0, 1.0, 0.5);
    base.drive(1.0, 1.0, 0.5);
    EXPECT_EQ(Mode::DRIVING, base.chassis.mode());
    const Measurement measured = base.chassis.model().measurement();
    EXPECT_NEAR(0.5, measured.yaw_rate, 1e-3) << pi_node::toString(kind);
    EXPECT_NEAR(1.005, base.chassis.teller()->speed(measured), 1e-3);
    EXPECT_NEAR(0.505, base.chassis.teller()->yawRate(measured), 1e-3);
  }
}

TEST(StockBase, BrakesWhenTwistsCeaseAndGoesOnWithTheNext)
{
  StockBaseDrive base;
  base.drive(3.0, 1.0, 0.2);
  base.step(0.40);  // 0.45 s after the last twist
  EXPECT_NEAR(1.0, base.speed(), 1e-3);
  base.step(1.6);
  EXPECT_EQ(0.0, base.speed());
  EXPECT_NEAR(0.0, base.chassis.model().measurement().yaw_rate, 1e-3);
  EXPECT_LT(base.fastest_change, 2.55);
  EXPECT_EQ(Mode::STOPPED_WATCHDOG, base.chassis.mode());
  base.drive(2.0, 1.0, 0.0);
  EXPECT_NEAR(1.0, base.speed(), 0.01);
}

TEST(StockBase, IgnoresWhatIsNoNumberAndBrakesIfNothingElseComes)
{
  StockBaseDrive base;
  base.drive(3.0, 1.0, 0.0);
  for (int i = 0; i < 8; ++i)
  {
    EXPECT_FALSE(base.chassis.onTwist(i % 2 == 0 ? NAN_VALUE : 0.0, i % 2 == 0 ? 0.0 : HUGE_VAL, base.now_ns));
    base.step(0.05);
  }
  EXPECT_NEAR(1.0, base.speed(), 1e-3) << "the last good one holds";
  for (int i = 0; i < 32; ++i)
  {
    EXPECT_FALSE(base.chassis.onTwist(NAN_VALUE, 0.0, base.now_ns));
    base.step(0.05);
  }
  EXPECT_EQ(0.0, base.speed());
  EXPECT_TRUE(base.chassis.model().pose().finite());
  EXPECT_EQ(60u + 8u + 32u, base.chassis.received());
}

TEST(StockBase, DoesNothingUnpluggedAndBeginsItsOdometryAnewAfterARestart)
{
  StockBaseDrive base;
  EXPECT_EQ("", base.chassis.path());
  base.drive(3.0, 1.0, 0.0);
  ASSERT_EQ("", base.chassis.command("unplug", base.now_ns));
  EXPECT_FALSE(base.chassis.isPlugged());
  EXPECT_EQ(nullptr, base.chassis.teller());
  base.drive(3.0, 1.0, 0.0);
  EXPECT_EQ(0.0, base.speed());
  ASSERT_EQ("", base.chassis.command("plug", base.now_ns));
  EXPECT_GT(base.chassis.teller()->odometry().x, 2.0);
  ASSERT_EQ("", base.chassis.command("restart", base.now_ns));
  EXPECT_EQ(0.0, base.chassis.teller()->odometry().x);
  ASSERT_EQ("", base.chassis.command("silent on", base.now_ns));
  EXPECT_EQ(nullptr, base.chassis.teller());
  base.drive(3.0, 1.0, 0.0);
  EXPECT_NEAR(1.0, base.speed(), 0.01) << "it says nothing, and listens";
  EXPECT_NE(std::string::npos, base.chassis.command("garbage 10", base.now_ns).find("has no line"));
}

TEST(StockBase, StandsWhileItsButtonIsPressedOrItsWheelsAreStuck)
{
  StockBaseDrive base;
  base.drive(2.0, 1.0, 0.5);
  ASSERT_EQ("", base.chassis.command("button on", base.now_ns));
  base.drive(2.0, 1.0, 0.5);
  EXPECT_EQ(0.0, base.speed());
  EXPECT_EQ(Mode::EMERGENCY_STOP, base.chassis.mode());
  ASSERT_EQ("", base.chassis.command("button off", base.now_ns));
  ASSERT_EQ("", base.chassis.command("stuck on", base.now_ns));
  const pi_vehicle::Pose2 before = base.chassis.model().pose();
  base.drive(2.0, 1.0, 0.5);
  EXPECT_EQ(0.0, (base.chassis.model().pose().position() - before.position()).norm());
  EXPECT_NEAR(before.heading, base.chassis.model().pose().heading, 1e-6);
}

}  // namespace
}  // namespace pi_simulation
