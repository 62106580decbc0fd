// config/chassis.yaml, twist_base.yaml and the defaults in the code must be the same, and impossible values must be
// named.

#include "ros/base/chassis_ros_options.h"
#include "ros/base/twist_base_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<ChassisRosOptions> chassis_reader("/chassis/");
const OptionsReader<TwistBaseRosOptions> twist_reader("/chassis/");

TEST(ChassisRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  chassis_reader.expectDefaultsOf(CHASSIS_YAML);
}

TEST(ChassisRosOptions, ParametersComeBackAsTheyWere)
{
  ChassisRosOptions options;
  options.driver.port = "usb-FTDI";
  options.driver.baud_rate = 921600;
  options.driver.host.motion_timeout_s = 0.5;
  options.wheels.publish_tf = true;
  Names unknown;
  const ChassisRosOptions again = ChassisRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(ChassisRosOptions().toText(), again.toText());
}

TEST(ChassisRosOptions, NamesUnknownParameters)
{
  Names unknown;
  ChassisRosOptions::fromParameters(fromYaml(YAML::Load("{baud: 1, limits: {jerk: 2}}")), "/chassis/", &unknown);
  EXPECT_EQ((Names{"/chassis/baud", "/chassis/limits/jerk"}), unknown);
}

TEST(ChassisRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /chassis/command_period_s = 0.1, must be in [0.002, 0.05]",
            chassis_reader.refusal("command_period_s: 0.1"));
  EXPECT_EQ("parameter /chassis/stop_deceleration = 3, must be in [0.01, 2.5] (vehicle/limits/emergency_deceleration)",
            chassis_reader.refusal("stop_deceleration: 3"));
  EXPECT_EQ("parameter /chassis/motion_timeout_s = soon, must be a number",
            chassis_reader.refusal("motion_timeout_s: soon"));
  EXPECT_EQ(0u,
            chassis_reader.refusal("baud_rate: 1234").find("parameter /chassis/baud_rate = 1234, must be one of 9600"));
  EXPECT_EQ(0u, chassis_reader.refusal("port: \"\"").find("parameter /chassis/port = \"\", must be a path"));
  EXPECT_EQ("parameter /chassis/odometry/speed_error = -1, must be in [0, 10]",
            chassis_reader.refusal("odometry: {speed_error: -1}"));
  EXPECT_EQ("parameter /chassis/odom_frame = \"\", must be a name", chassis_reader.refusal("odom_frame: \"\""));
}

TEST(TwistBaseRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  twist_reader.expectDefaultsOf(TWIST_BASE_YAML);
}

TEST(TwistBaseRosOptions, TakeTheVehicle)
{
  pi_node::VehicleDescription vehicle;
  vehicle.kind = pi_node::VehicleKind::DIFFERENTIAL;
  vehicle.wheelbase = 0.0;
  vehicle.limits.emergency_deceleration = 4.0;
  Names unknown;
  const auto load = [&](const std::string& yaml)
  { return TwistBaseRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "", vehicle, &unknown).base; };
  EXPECT_EQ(4.0, load("stop_deceleration: 3").limits.deceleration);
  EXPECT_EQ(1.0, load("stop_deceleration: 3").limits.usual_deceleration);
  EXPECT_THROW(load("steering_angle: true"), std::invalid_argument);
}

TEST(TwistBaseRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /chassis/stop_deceleration = 3, must be in [0.01, 2.5] (vehicle/limits/emergency_deceleration)",
            twist_reader.refusal("stop_deceleration: 3"));
  EXPECT_EQ("parameter /chassis/odometry/speed_error = -1, must be in [0, 10]",
            twist_reader.refusal("odometry: {speed_error: -1}"));
}

}  // namespace
}  // namespace pi_vehicle
