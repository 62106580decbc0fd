// The simulated vehicle against closed forms.

#include "chassis/chassis_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace pi_simulation
{

using namespace pi_vehicle::chassis;

namespace
{

Setpoint setpoint(double speed, double curvature)
{
  Setpoint set;
  set.speed = speed;
  set.curvature = curvature;
  return set;
}

void drive(ChassisModel* model, const Setpoint& set, double seconds)
{
  for (int i = 0; i < std::lround(seconds / 0.005); ++i)
  {
    model->step(set, 0.005);
  }
}

class ModelOfKind : public testing::TestWithParam<Kind>
{
};

TEST_P(ModelOfKind, DrivesTheCircleOfItsCurvature)
{
  ModelOptions options;
  options.kind = GetParam();
  ChassisModel model(options);
  const double curvature = 0.25;
  drive(&model, setpoint(0.0, curvature), 3.0);  // steering is there before it moves
  EXPECT_NEAR(curvature, model.measurement().curvature, 1e-6);
  drive(&model, setpoint(1.0, curvature), 12.0);
  drive(&model, setpoint(0.0, curvature), 3.0);
  const pi_vehicle::Pose2 end = model.pose();
  const double travel = model.measurement().travel;
  EXPECT_GT(travel, 11.9);
  EXPECT_NEAR(std::sin(travel * curvature) / curvature, end.x, 1e-4);
  EXPECT_NEAR((1.0 - std::cos(travel * curvature)) / curvature, end.y, 1e-4);
  EXPECT_NEAR(travel * curvature, end.heading, 1e-4);
}

INSTANTIATE_TEST_SUITE_P(Both, ModelOfKind, testing::Values(Kind::CAR_LIKE, Kind::DIFFERENTIAL));

TEST(ChassisModel, SteeringAngleIsThatOfTheBicycleAndNoGreaterThanItsLimit)
{
  ChassisModel model((ModelOptions()));
  drive(&model, setpoint(0.0, 0.25), 3.0);
  EXPECT_NEAR(std::atan(0.75 * 0.25), model.measurement().steering, 1e-6);
  drive(&model, setpoint(0.0, 5.0), 3.0);
  EXPECT_NEAR(0.33, model.measurement().steering, 1e-6);
  EXPECT_NEAR(std::tan(0.33) / 0.75, model.measurement().curvature, 1e-6);
}

TEST(ChassisModel, SteeringIsNoFasterThanItsRate)
{
  ModelOptions options;
  options.max_steering_rate = 0.4;
  options.dead_time_s = 0.0;
  options.steering_lag_s = 0.0;
  ChassisModel model(options);
  drive(&model, setpoint(0.0, 5.0), 0.5);
  EXPECT_NEAR(0.2, model.measurement().steering, 1e-9);
}

TEST(ChassisModel, SpeedIsAFirstOrderLagAfterTheDeadTime)
{
  ChassisModel model((ModelOptions()));
  drive(&model, setpoint(1.0, 0.0), 0.05);
  EXPECT_NEAR(0.0, model.measurement().speed, 1e-12);
  drive(&model, setpoint(1.0, 0.0), 0.15);
  EXPECT_NEAR(1.0 - std::exp(-1.0), model.measurement().speed, 0.005);
}

TEST(ChassisModel, StopsInTheDistanceOfRampLagAndDeadTime)
{
  ChassisModel model((ModelOptions()));
  drive(&model, setpoint(2.0, 0.0), 5.0);
  const double start = model.measurement().travel;
  double speed = 2.0;
  for (int i = 0; i < 1000; ++i)
  {
    speed = rampSpeed(speed, 0.0, 1.0, 2.5, 0.005);
    model.step(setpoint(speed, 0.0), 0.005);
  }
  EXPECT_EQ(0.0, model.measurement().speed);
  // The integral of a first-order lag's answer is that of its input plus lag times what the speed fell by. The ramp
  // goes in steps of 5 ms, of which each begins at its end: half a step of 2 m/s less; stiction ends the tail.
  const double expected = 2.0 * 2.0 / (2.0 * 2.5) + 2.0 * 0.15 + 2.0 * 0.05;
  EXPECT_NEAR(expected, model.measurement().travel - start, 0.008);
}

TEST(ChassisModel, BatteryGivesPowerAndEndsEmpty)
{
  ModelOptions options;
  options.idle_power = 100.0;
  options.battery_capacity = 1.0;
  options.battery_resistance = 0.05;
  options.battery_charge = 0.5;
  ChassisModel model(options);
  drive(&model, setpoint(0.0, 0.0), 1.0);
  const Measurement before = model.measurement();
  EXPECT_NEAR(-100.0, *before.battery_voltage * *before.battery_current, 1e-6);
  EXPECT_NEAR(0.5 + *before.battery_current / 3600.0, *before.battery_charge, 1e-5);
  EXPECT_EQ(0, before.faults);
  drive(&model, setpoint(1.0, 0.0), 3.0);
  EXPECT_LT(*model.measurement().battery_current, *before.battery_current);
  model.setBatteryCharge(0.1);
  EXPECT_EQ(BATTERY_LOW, model.measurement().faults);
  model.setBatteryCharge(-1.0);
  EXPECT_EQ(BATTERY_LOW | BATTERY_EMPTY, model.measurement().faults);
}

TEST(ChassisModel, SlippingWheelsGoFartherThanTheVehicle)
{
  ChassisModel model((ModelOptions()));
  model.setSlip(0.2);
  drive(&model, setpoint(1.0, 0.0), 5.0);
  EXPECT_NEAR(0.8 * model.measurement().travel, model.pose().x, 1e-9);
  EXPECT_NEAR(1.0, model.measurement().speed, 1e-6);
  EXPECT_NEAR(0.8, model.groundSpeed(), 1e-6);
}

TEST(ChassisModel, StuckWheelsDoNotTurn)
{
  ChassisModel model((ModelOptions()));
  model.setStuck(true);
  drive(&model, setpoint(1.0, 0.0), 2.0);
  EXPECT_EQ(0.0, model.measurement().travel);
  model.setStuck(false);
  drive(&model, setpoint(1.0, 0.0), 2.0);
  EXPECT_GT(model.measurement().travel, 1.0);
}

TEST(ChassisModel, WrongOptionsAreNamed)
{
  ModelOptions options;
  options.wheelbase = 0.0;
  EXPECT_THROW(ChassisModel{options}, std::invalid_argument);
}

}  // namespace
}  // namespace pi_simulation
