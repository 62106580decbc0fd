// config/vehicle_simulator.yaml and the defaults in the code must be the same, and impossible values must be named.

#include "ros/vehicle_simulator_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <string>

namespace pi_simulation
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<VehicleSimulatorRosOptions> reader("/simulator/");

TEST(VehicleSimulatorRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  reader.expectDefaultsOf(SIMULATOR_YAML);
}

TEST(VehicleSimulatorRosOptions, ParametersComeBackAsTheyWere)
{
  VehicleSimulatorRosOptions options;
  options.scenario = "a.yaml";
  options.base = Base::TWIST;
  options.cameras.color = false;
  options.cameras.threads = 2;
  Names unknown;
  const auto again = VehicleSimulatorRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(VehicleSimulatorRosOptions().toText(), again.toText());
}

TEST(VehicleSimulatorRosOptions, ReachTheSimulationAndTheRenderer)
{
  VehicleSimulatorRosOptions options;
  options.imu_noise = 0.0;
  options.vehicle.footprint.front = 1.4;
  options.vehicle.mounts["imu_link"] = {0.5, 0.0, 0.9, 0.0, 0.0, 0.0};
  options.vehicle.limits.speed = 2.0;
  options.vehicle.picture_width = 320;
  options.cameras.smooth_edges = true;
  options.link = "/dev/a";
  options.base = Base::TWIST;
  EXPECT_EQ(Base::TWIST, options.simulationOptions().chassis.base);
  EXPECT_EQ(1.4, options.simulationOptions().footprint.front);
  EXPECT_EQ(Eigen::Vector3d(0.5, 0.0, 0.9), options.simulationOptions().imu_in_base);
  EXPECT_EQ(2.0, options.simulationOptions().chassis.limits.speed);
  EXPECT_EQ(320, options.calibration().left.model.width);
  EXPECT_TRUE(options.calibration().right.T_body_camera.translation().isApprox(Eigen::Vector3d(0.3, -0.06, 0.1)));
  EXPECT_EQ(0.0, options.simulationOptions().imu.gyro_bias.norm());
  EXPECT_EQ("/dev/a", options.simulationOptions().chassis.link);
  EXPECT_EQ(Supersampling::EDGES, options.rendererOptions().supersampling);
  EXPECT_EQ(RenderQuality::LIVE, options.rendererOptions().quality);
}

TEST(VehicleSimulatorRosOptions, RefusesAVehicleThatIsNotSimulated)
{
  VehicleSimulatorRosOptions options;
  options.validate();
  options.vehicle.mounts["left_optical"].pitch = 0.1;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options.vehicle = pi_node::VehicleDescription();
  options.vehicle.mounts["right_optical"].y = 0.1;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options.vehicle.mounts.erase("imu_link");
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

TEST(VehicleSimulatorRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /simulator/cameras/threads = 0, must be in [1, 64]", reader.refusal("cameras: {threads: 0}"));
  EXPECT_EQ("parameter /simulator/base = \"tracks\", must be serial or twist", reader.refusal("base: tracks"));
  EXPECT_EQ("parameter /simulator/imu_noise = much, must be a number", reader.refusal("imu_noise: much"));
  EXPECT_EQ("parameter /simulator/map_frame = \"\", must be a name", reader.refusal("map_frame: \"\""));
  Names unknown;
  VehicleSimulatorRosOptions::fromParameters(fromYaml(YAML::Load("{camera: 1}")), "/simulator/", &unknown);
  EXPECT_EQ(Names{"/simulator/camera"}, unknown);
}

}  // namespace
}  // namespace pi_simulation
