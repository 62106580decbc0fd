// config/obstacles.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_detect/ros/obstacles_ros_options.h>
#include <pi_runtime/test_support/yaml_parameters.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace pi_detect
{

using namespace pi_runtime::test_support;
namespace
{

std::string refusal(const std::string& yaml)
{
  try
  {
    std::vector<std::string> unknown;
    ObstaclesRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/obstacles/", &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(ObstaclesRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(OBSTACLES_YAML));
  std::vector<std::string> unknown;
  const ObstaclesRosOptions options = ObstaclesRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(ObstaclesRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(ObstaclesRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(ObstaclesRosOptions, ParametersComeBackAsTheyWere)
{
  ObstaclesRosOptions options;
  options.source = StereoSource::RAW;
  options.tracks_rectified = false;
  options.stereo.max_range_m = 12.0;
  options.tracker.confirm_hits = 4;
  options.odom_frame = "wheels";
  std::vector<std::string> unknown;
  const ObstaclesRosOptions again = ObstaclesRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(ObstaclesRosOptions().toText(), again.toText());
}

TEST(ObstaclesRosOptions, NamesUnknownParameters)
{
  std::vector<std::string> unknown;
  ObstaclesRosOptions::fromParameters(fromYaml(YAML::Load("{stereo: {range: 3}, rectify: true}")), "/obstacles/",
                                      &unknown);
  EXPECT_EQ((std::vector<std::string>{"/obstacles/rectify", "/obstacles/stereo/range"}), unknown);
}

TEST(ObstaclesRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /obstacles/source = \"mono\", must be rectified, raw or disparity", refusal("source: mono"));
  EXPECT_EQ("parameter /obstacles/pair_tolerance_s = 0.5, must be in [0, 0.1]", refusal("pair_tolerance_s: 0.5"));
  EXPECT_EQ("parameter /obstacles/odom_frame = \"base_link\", must be another frame than base_link_frame",
            refusal("odom_frame: base_link"));
  EXPECT_EQ("parameter /obstacles/base_link_frame = \"/base\", must be a frame name without leading /",
            refusal("base_link_frame: /base"));
  EXPECT_EQ("parameter /obstacles/tracks_rectified = false, must be true with source = disparity",
            refusal("{source: disparity, tracks_rectified: false}"));
  EXPECT_EQ("parameter /obstacles/min_coverage = nan, must be in [0, 1]", refusal("min_coverage: .nan"));
  // Bounds of the core come under their names as well.
  EXPECT_EQ(0u, refusal("stereo: {max_range_m: -1}").find("parameter /obstacles/stereo/max_range_m = -1"))
      << refusal("stereo: {max_range_m: -1}");
  EXPECT_EQ(0u, refusal("tracker: {confirm_hits: 0}").find("parameter /obstacles/tracker/confirm_hits = 0"))
      << refusal("tracker: {confirm_hits: 0}");
}

}  // namespace
}  // namespace pi_detect
