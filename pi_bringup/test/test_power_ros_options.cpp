// config/power.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_bringup/ros/power_ros_options.h>
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
    PowerRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/power/", &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(PowerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(POWER_YAML));
  std::vector<std::string> unknown;
  const PowerRosOptions options = PowerRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(PowerRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(PowerRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(PowerRosOptions, ParametersComeBackAsTheyWere)
{
  PowerRosOptions options;
  options.services = {{"slam", {"/vio"}, {"vio_*"}, true}};
  options.sensors = {"VDD_IN"};
  options.model.frequency_ghz = 0.0;
  options.battery.capacity_ah = 10.0;
  std::vector<std::string> unknown;
  const PowerRosOptions again = PowerRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(PowerRosOptions().toText(), again.toText());
}

TEST(PowerRosOptions, WrongValuesAreNamedWithTheirBounds)
{
  EXPECT_EQ("parameter /power/period_s = 0, must be in [0.1, 60]", refusal("period_s: 0.0"));
  EXPECT_EQ("parameter /power/model/idle_w = -1, must be in [0, 1000]", refusal("model: {idle_w: -1.0}"));
  EXPECT_EQ("parameter /power/battery/capacity_ah = 0, must be in [0.01, 10000]", refusal("battery: {capacity_ah: 0}"));
  EXPECT_NE(std::string::npos, refusal("services: 5").find("services = 5, must be a list of maps"))
      << refusal("services: 5");
  EXPECT_NE(std::string::npos, refusal("services: [{name: slam}]").find("entry 1: service slam has no nodes"));
  EXPECT_NE(std::string::npos,
            refusal("services: [{name: slam, nodes: [a], colour: red}]").find("colour means nothing"));
  EXPECT_NE(std::string::npos,
            refusal("services: [{name: a, nodes: [a]}, {name: a, nodes: [b]}]").find("two services"));
  EXPECT_NE(std::string::npos, refusal("sensors: VDD_IN").find("must be a list of texts"));
}

TEST(PowerRosOptions, UnknownNamesAreTold)
{
  std::vector<std::string> unknown;
  PowerRosOptions::fromParameters(fromYaml(YAML::Load("batery: {capacity_ah: 1.0}")), "/power/", &unknown);
  EXPECT_EQ(std::vector<std::string>{"/power/batery/capacity_ah"}, unknown);
}

}  // namespace
}  // namespace pi_bringup
