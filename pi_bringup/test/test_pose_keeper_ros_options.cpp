// config/pose_keeper.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_bringup/ros/pose_keeper_ros_options.h>
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

PoseKeeperRosOptions load(const std::string& yaml)
{
  std::vector<std::string> unknown;
  return PoseKeeperRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/pose_keeper/", &unknown);
}

std::string refusal(const std::string& yaml)
{
  try
  {
    load(yaml);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(PoseKeeperRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(POSE_KEEPER_YAML));
  std::vector<std::string> unknown;
  const PoseKeeperRosOptions options = PoseKeeperRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(PoseKeeperRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(PoseKeeperRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(PoseKeeperRosOptions, ParametersComeBackAsTheyWere)
{
  PoseKeeperRosOptions options;
  options.file = "/var/lib/vehicle/pose.yaml";
  options.resume = true;
  options.max_file_age_s = 60.0;
  options.keeper.silence_s = 0.5;
  options.keeper.stop_deceleration = 2.0;
  std::vector<std::string> unknown;
  const PoseKeeperRosOptions again = PoseKeeperRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(PoseKeeperRosOptions().toText(), again.toText());
}

TEST(PoseKeeperRosOptions, NamesUnknownParameters)
{
  std::vector<std::string> unknown;
  PoseKeeperRosOptions::fromParameters(fromYaml(YAML::Load("{silence: 1}")), "/pose_keeper/", &unknown);
  EXPECT_EQ((std::vector<std::string>{"/pose_keeper/silence"}), unknown);
}

TEST(PoseKeeperRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /pose_keeper/silence_s = 0, must be in [0.05, 5]", refusal("silence_s: 0"));
  EXPECT_EQ("parameter /pose_keeper/silence_s = long, must be a number", refusal("silence_s: long"));
  EXPECT_EQ("parameter /pose_keeper/file = \"pose.yaml\", must be an absolute path, or empty",
            refusal("file: pose.yaml"));
  EXPECT_EQ("parameter /pose_keeper/resume = true, must be false without a file", refusal("resume: true"));
  EXPECT_EQ("parameter /pose_keeper/base_link_frame = \"map\", must be a name other than map_frame",
            refusal("base_link_frame: map"));
  EXPECT_NE("", refusal("max_file_age_s: .nan"));
  EXPECT_NE("", refusal("warning_period_s: -1"));
}

}  // namespace
}  // namespace pi_bringup
