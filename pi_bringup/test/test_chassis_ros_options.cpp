// config/chassis.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_bringup/ros/chassis_ros_options.h>
#include <pi_runtime/test_support/yaml_parameters.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_bringup
{

using namespace pi_runtime::test_support;
namespace
{

std::string refusal(const std::string& yaml)
{
  try
  {
    std::vector<std::string> unknown;
    ChassisRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/chassis/", &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(ChassisRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(CHASSIS_YAML));
  std::vector<std::string> unknown;
  const ChassisRosOptions options = ChassisRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(ChassisRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(ChassisRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(ChassisRosOptions, ParametersComeBackAsTheyWere)
{
  ChassisRosOptions options;
  options.driver.port = "usb-FTDI";
  options.driver.baud_rate = 921600;
  options.driver.host.motion_timeout_s = 0.5;
  options.driver.host.limits.speed = 1.5;
  options.publish_tf = true;
  std::vector<std::string> unknown;
  const ChassisRosOptions again = ChassisRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(ChassisRosOptions().toText(), again.toText());
}

TEST(ChassisRosOptions, NamesUnknownParameters)
{
  std::vector<std::string> unknown;
  ChassisRosOptions::fromParameters(fromYaml(YAML::Load("{baud: 1, limits: {jerk: 2}}")), "/chassis/", &unknown);
  EXPECT_EQ((std::vector<std::string>{"/chassis/baud", "/chassis/limits/jerk"}), unknown);
}

TEST(ChassisRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /chassis/command_period_s = 0.1, must be in [0.002, 0.05]", refusal("command_period_s: 0.1"));
  EXPECT_EQ("parameter /chassis/limits/speed = 0, must be in [0.01, 30]", refusal("limits: {speed: 0}"));
  EXPECT_EQ("parameter /chassis/motion_timeout_s = soon, must be a number", refusal("motion_timeout_s: soon"));
  EXPECT_EQ(0u, refusal("baud_rate: 1234").find("parameter /chassis/baud_rate = 1234, must be one of 9600"));
  EXPECT_EQ(0u, refusal("port: \"\"").find("parameter /chassis/port = \"\", must be a path"));
  EXPECT_EQ("parameter /chassis/odometry/speed_error = -1, must be in [0, 10]", refusal("odometry: {speed_error: -1}"));
  EXPECT_EQ("parameter /chassis/odom_frame = \"\", must be a name", refusal("odom_frame: \"\""));
}

}  // namespace
}  // namespace pi_bringup
