// config/vehicle_simulator.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_bringup/ros/vehicle_simulator_ros_options.h>
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
    VehicleSimulatorRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/simulator/", &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(VehicleSimulatorRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(SIMULATOR_YAML));
  std::vector<std::string> unknown;
  const VehicleSimulatorRosOptions options = VehicleSimulatorRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(VehicleSimulatorRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(VehicleSimulatorRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(VehicleSimulatorRosOptions, ParametersComeBackAsTheyWere)
{
  VehicleSimulatorRosOptions options;
  options.scenario = "a.yaml";
  options.cameras.color = true;
  options.cameras.threads = 2;
  options.imu_in_base.z = 1.3;
  std::vector<std::string> unknown;
  const auto again = VehicleSimulatorRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(VehicleSimulatorRosOptions().toText(), again.toText());
}

TEST(VehicleSimulatorRosOptions, ReachTheSimulationAndTheRenderer)
{
  VehicleSimulatorRosOptions options;
  options.imu_noise = 0.0;
  options.outline.front = 1.4;
  options.cameras.smooth_edges = true;
  options.link = "/dev/a";
  EXPECT_EQ(1.4, options.simulationOptions().front);
  EXPECT_EQ(0.0, options.simulationOptions().imu.gyro_bias.norm());
  EXPECT_EQ("/dev/a", options.simulationOptions().chassis.link);
  EXPECT_EQ(pi_slam::Supersampling::EDGES, options.rendererOptions().supersampling);
  EXPECT_EQ(pi_slam::RenderQuality::LIVE, options.rendererOptions().quality);
}

TEST(VehicleSimulatorRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /simulator/cameras/threads = 0, must be in [1, 64]", refusal("cameras: {threads: 0}"));
  EXPECT_EQ("parameter /simulator/imu_noise = much, must be a number", refusal("imu_noise: much"));
  EXPECT_EQ("parameter /simulator/outline/front = 0, must be in [0.05, 10]", refusal("outline: {front: 0}"));
  EXPECT_EQ("parameter /simulator/map_frame = \"\", must be a name", refusal("map_frame: \"\""));
  std::vector<std::string> unknown;
  VehicleSimulatorRosOptions::fromParameters(fromYaml(YAML::Load("{camera: 1}")), "/simulator/", &unknown);
  EXPECT_EQ(std::vector<std::string>{"/simulator/camera"}, unknown);
}

}  // namespace
}  // namespace pi_bringup
