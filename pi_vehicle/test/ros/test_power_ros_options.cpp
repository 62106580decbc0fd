// config/power.yaml and the defaults in the code must be the same, and impossible values must be named.

#include "ros/power_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<PowerRosOptions> power_reader("/power/");

TEST(PowerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  power_reader.expectDefaultsOf(POWER_YAML);
}

TEST(PowerRosOptions, ParametersComeBackAsTheyWere)
{
  PowerRosOptions options;
  options.services = {{"slam", {"/vio"}, {"vio_*"}, true}};
  options.sensors = {"VDD_IN"};
  options.model.frequency_ghz = 0.0;
  options.battery.capacity_ah = 10.0;
  Names unknown;
  const PowerRosOptions again = PowerRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(PowerRosOptions().toText(), again.toText());
}

TEST(PowerRosOptions, WrongValuesAreNamedWithTheirBounds)
{
  EXPECT_EQ("parameter /power/period_s = 0, must be in [0.1, 60]", power_reader.refusal("period_s: 0.0"));
  EXPECT_EQ("parameter /power/model/idle_w = -1, must be in [0, 1000]", power_reader.refusal("model: {idle_w: -1.0}"));
  EXPECT_EQ("parameter /power/battery/capacity_ah = 0, must be in [0.01, 10000]",
            power_reader.refusal("battery: {capacity_ah: 0}"));
  EXPECT_NE(std::string::npos, power_reader.refusal("services: 5").find("services = 5, must be a list of maps"))
      << power_reader.refusal("services: 5");
  EXPECT_NE(std::string::npos,
            power_reader.refusal("services: [{name: slam}]").find("entry 1: service slam has no nodes"));
  EXPECT_NE(std::string::npos,
            power_reader.refusal("services: [{name: slam, nodes: [a], colour: red}]").find("colour means nothing"));
  EXPECT_NE(std::string::npos,
            power_reader.refusal("services: [{name: a, nodes: [a]}, {name: a, nodes: [b]}]").find("two services"));
  EXPECT_NE(std::string::npos, power_reader.refusal("sensors: VDD_IN").find("must be a list of texts"));
}

TEST(PowerRosOptions, UnknownNamesAreTold)
{
  Names unknown;
  PowerRosOptions::fromParameters(fromYaml(YAML::Load("batery: {capacity_ah: 1.0}")), "/power/", &unknown);
  EXPECT_EQ(Names{"/power/batery/capacity_ah"}, unknown);
}

}  // namespace
}  // namespace pi_vehicle
