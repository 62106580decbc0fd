// config/pose_keeper.yaml and the defaults in the code must be the same, and impossible values must be named.

#include "ros/pose_keeper_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<PoseKeeperRosOptions> pose_keeper_reader("/pose_keeper/");

TEST(PoseKeeperRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  pose_keeper_reader.expectDefaultsOf(POSE_KEEPER_YAML);
}

TEST(PoseKeeperRosOptions, ParametersComeBackAsTheyWere)
{
  PoseKeeperRosOptions options;
  options.file = "/var/lib/vehicle/pose.yaml";
  options.resume = true;
  options.max_file_age_s = 60.0;
  options.keeper.silence_s = 0.5;
  options.keeper.retry_s = 2.0;
  Names unknown;
  const PoseKeeperRosOptions again = PoseKeeperRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(Names(), unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(PoseKeeperRosOptions().toText(), again.toText());
}

TEST(PoseKeeperRosOptions, NamesUnknownParameters)
{
  Names unknown;
  PoseKeeperRosOptions::fromParameters(fromYaml(YAML::Load("{silence: 1}")), "/pose_keeper/", &unknown);
  EXPECT_EQ((Names{"/pose_keeper/silence"}), unknown);
}

TEST(PoseKeeperRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /pose_keeper/silence_s = 0, must be in [0.05, 5]", pose_keeper_reader.refusal("silence_s: 0"));
  EXPECT_EQ("parameter /pose_keeper/silence_s = long, must be a number", pose_keeper_reader.refusal("silence_s: long"));
  EXPECT_EQ("parameter /pose_keeper/file = \"pose.yaml\", must be an absolute path, or empty",
            pose_keeper_reader.refusal("file: pose.yaml"));
  EXPECT_EQ("parameter /pose_keeper/resume = true, must be false without a file",
            pose_keeper_reader.refusal("resume: true"));
  EXPECT_EQ("parameter /pose_keeper/base_link_frame = \"map\", must be a name other than map_frame",
            pose_keeper_reader.refusal("base_link_frame: map"));
  EXPECT_NE("", pose_keeper_reader.refusal("max_file_age_s: .nan"));
  EXPECT_NE("", pose_keeper_reader.refusal("warning_period_s: -1"));
}

}  // namespace
}  // namespace pi_vehicle
