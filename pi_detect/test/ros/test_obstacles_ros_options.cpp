// config/obstacles.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "ros/obstacles/obstacles_ros_options.h"

#include <string>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<ObstaclesRosOptions> obstacles_reader("/obstacles/");

TEST(ObstaclesRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  obstacles_reader.expectDefaultsOf(OBSTACLES_YAML);
}

TEST(ObstaclesRosOptions, ParametersComeBackAsTheyWere)
{
  ObstaclesRosOptions options;
  options.source = StereoSource::RAW;
  options.tracks_rectified = false;
  options.stereo.max_range_m = 12.0;
  options.tracker.confirm_hits = 4;
  options.odom_frame = "wheels";
  Names unknown;
  const ObstaclesRosOptions again = ObstaclesRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(ObstaclesRosOptions().toText(), again.toText());
}

TEST(ObstaclesRosOptions, NamesUnknownParameters)
{
  Names unknown;
  ObstaclesRosOptions::fromParameters(fromYaml(YAML::Load("{stereo: {range: 3}, rectify: true}")), "/obstacles/",
                                      &unknown);
  EXPECT_EQ((Names{"/obstacles/rectify", "/obstacles/stereo/range"}), unknown);
}

TEST(ObstaclesRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /obstacles/source = \"mono\", must be rectified, raw or disparity",
            obstacles_reader.refusal("source: mono"));
  EXPECT_EQ("parameter /obstacles/pair_tolerance_s = 0.5, must be in [0, 0.1]",
            obstacles_reader.refusal("pair_tolerance_s: 0.5"));
  EXPECT_EQ("parameter /obstacles/odom_frame = \"base_link\", must be another frame than base_link_frame",
            obstacles_reader.refusal("odom_frame: base_link"));
  EXPECT_EQ("parameter /obstacles/base_link_frame = \"/base\", must be a frame name without leading /",
            obstacles_reader.refusal("base_link_frame: /base"));
  EXPECT_EQ("parameter /obstacles/tracks_rectified = false, must be true with source = disparity",
            obstacles_reader.refusal("{source: disparity, tracks_rectified: false}"));
  EXPECT_EQ("parameter /obstacles/min_coverage = nan, must be in [0, 1]",
            obstacles_reader.refusal("min_coverage: .nan"));
  // Bounds of the core come under their names as well.
  EXPECT_EQ(0u,
            obstacles_reader.refusal("stereo: {max_range_m: -1}").find("parameter /obstacles/stereo/max_range_m = -1"))
      << obstacles_reader.refusal("stereo: {max_range_m: -1}");
  EXPECT_EQ(
      0u, obstacles_reader.refusal("tracker: {confirm_hits: 0}").find("parameter /obstacles/tracker/confirm_hits = 0"))
      << obstacles_reader.refusal("tracker: {confirm_hits: 0}");
}

}  // namespace
}  // namespace pi_detect
