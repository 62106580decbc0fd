// config/vehicle.yaml and the defaults in the code are the same vehicle, and a description that cannot be is named.

#include "pi_node/ros/vehicle_parameters.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/yaml_parameters.h>

#include <string>

namespace pi_node
{
namespace
{

using test_support::messageOf;

std::string text(XmlRpc::XmlRpcValue value)
{
  return value.toXml();
}

TEST(VehicleDescription, DefaultsAreThoseOfTheFile)
{
  const XmlRpc::XmlRpcValue file = fromYaml(YAML::LoadFile(VEHICLE_YAML));
  EXPECT_EQ(text(toParameters(VehicleDescription())), text(toParameters(vehicleFromParameters(file, "/vehicle"))));
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  test_support::collectNames(file, "", &in_file);
  test_support::collectNames(toParameters(VehicleDescription()), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(VehicleDescription, ComesBackAsItWas)
{
  VehicleDescription vehicle;
  vehicle.name = "tug";
  vehicle.kind = VehicleKind::DIFFERENTIAL;
  vehicle.wheelbase = 0.0;
  vehicle.limits.speed = 1.5;
  vehicle.mounts = {{"rear_optical", {-0.4, 0.0, 0.8, 0.0, 0.1, 3.14}}};
  const VehicleDescription again = vehicleFromParameters(toParameters(vehicle), "/vehicle");
  EXPECT_EQ(text(toParameters(vehicle)), text(toParameters(again)));
  EXPECT_EQ(0.8, again.mount("rear_optical").z);
  EXPECT_EQ("vehicle/mounts/imu_link is missing",
            messageOf<std::invalid_argument>([&again] { again.mount("imu_link"); }));
}

TEST(VehicleDescription, IsRefusedWithParameterValueAndBound)
{
  const YAML::Node refusals = YAML::LoadFile(REFUSALS_YAML);
  ASSERT_GT(refusals.size(), 20u);
  for (const YAML::Node& entry : refusals)
  {
    YAML::Node file = YAML::LoadFile(VEHICLE_YAML);
    const std::string path = entry["change"].begin()->first.as<std::string>();
    const YAML::Node value = entry["change"].begin()->second;
    const size_t slash = path.find('/');
    YAML::Node part = slash == std::string::npos ? file : file[path.substr(0, slash)];
    const std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
    value.IsNull() ? static_cast<void>(part.remove(name)) : static_cast<void>(part[name] = value);
    const std::string said =
        messageOf<std::invalid_argument>([&] { vehicleFromParameters(fromYaml(file), "/vehicle"); });
    EXPECT_EQ(0u, said.find("parameter /vehicle/")) << said;
    EXPECT_NE(std::string::npos, said.find(entry["refusal"].as<std::string>())) << said;
  }
  EXPECT_EQ("parameter /vehicle = 5, must be a map as in config/vehicle.yaml of pi_node",
            messageOf<std::invalid_argument>([] { vehicleFromParameters(XmlRpc::XmlRpcValue(5), "/vehicle"); }));
}

}  // namespace
}  // namespace pi_node
