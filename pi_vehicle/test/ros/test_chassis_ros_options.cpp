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
  options.driver.host.limits.speed = 1.5;
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
  EXPECT_EQ("parameter /chassis/limits/speed = 0, must be in [0.01, 30]", chassis_reader.refusal("limits: {speed: 0}"));
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

TEST(TwistBaseRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /chassis/wheelbase = 0, must be in [0.05, 10]", twist_reader.refusal("wheelbase: 0"));
  EXPECT_EQ("parameter /chassis/limits/speed = 0, must be in [0.01, 30]", twist_reader.refusal("limits: {speed: 0}"));
  EXPECT_EQ("parameter /chassis/odometry/speed_error = -1, must be in [0, 10]",
            twist_reader.refusal("odometry: {speed_error: -1}"));
}

}  // namespace
}  // namespace pi_vehicle
