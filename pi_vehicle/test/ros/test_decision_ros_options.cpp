// The files config/{arbiter,command,reaction}_node.yaml and the defaults in the code must be the same, and impossible
// values must be named.

#include "ros/decision_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/yaml_parameters.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

template <typename Options>
void expectFileEqualsCode(const std::string& file)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(file));
  std::vector<std::string> unknown;
  const Options options = Options::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(Options().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(Options().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

template <typename Options>
std::string refusal(const std::string& yaml)
{
  try
  {
    std::vector<std::string> unknown;
    Options::fromParameters(fromYaml(YAML::Load(yaml)), "/node/", &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(DecisionRosOptions, DefaultsAreThoseOfTheYamlFiles)
{
  expectFileEqualsCode<ArbiterRosOptions>(CONFIG_DIR "/arbiter_node.yaml");
  expectFileEqualsCode<CommandRosOptions>(CONFIG_DIR "/command_node.yaml");
  expectFileEqualsCode<ReactionRosOptions>(CONFIG_DIR "/reaction_node.yaml");
}

TEST(DecisionRosOptions, ParametersComeBackAsTheyWere)
{
  CommandRosOptions options;
  options.actions_file = "/etc/commands.yaml";
  options.rate = 50.0;
  options.stopped_at_start = true;
  options.question = "";
  std::vector<std::string> unknown;
  const auto again = CommandRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(CommandRosOptions().toText(), again.toText());
}

TEST(DecisionRosOptions, NamesUnknownParameters)
{
  std::vector<std::string> unknown;
  ReactionRosOptions::fromParameters(fromYaml(YAML::Load("{rules: 1, need: {obstacles: 2}}")), "/reaction/", &unknown);
  EXPECT_EQ((std::vector<std::string>{"/reaction/need/obstacles", "/reaction/rules"}), unknown);
}

TEST(DecisionRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /node/rate = 5, must be in [20, 100]", refusal<ArbiterRosOptions>("rate: 5"));
  EXPECT_EQ("parameter /node/vehicle_state_timeout = soon, must be a number",
            refusal<ArbiterRosOptions>("vehicle_state_timeout: soon"));
  EXPECT_EQ(
      "parameter /node/sources_file = \"a/b.yaml\", must be an absolute path, or the name of a file in the folder "
      "config of pi_vehicle",
      refusal<ArbiterRosOptions>("sources_file: a/b.yaml"));
  EXPECT_EQ("parameter /node/stop_deceleration = -1, must be in [0, 20]",
            refusal<CommandRosOptions>("stop_deceleration: -1"));
  EXPECT_EQ("parameter /node/stopped_at_start = 1, must be true or false",
            refusal<CommandRosOptions>("stopped_at_start: 1"));
  EXPECT_EQ("parameter /node/map_frame = \"\", must be a name", refusal<CommandRosOptions>("map_frame: \"\""));
  EXPECT_EQ("parameter /node/obstacles_timeout = 0, must be in [0.05, 60]",
            refusal<ReactionRosOptions>("obstacles_timeout: 0"));
  EXPECT_EQ(0U, refusal<ReactionRosOptions>("rules_file: \"\"").find("parameter /node/rules_file = \"\", must be"));
}

TEST(DecisionRosOptions, PathsStayAndNamesAreThoseOfThePackage)
{
  EXPECT_EQ("/etc/rules.yaml", configPath("rules_file", "/etc/rules.yaml"));
  const std::string path = configPath("rules_file", "reaction.yaml");
  EXPECT_NE(std::string::npos, path.find("/config/reaction.yaml")) << path;
  EXPECT_THROW(configPath("rules_file", "config/reaction.yaml"), std::invalid_argument);
}

}  // namespace
}  // namespace pi_vehicle
