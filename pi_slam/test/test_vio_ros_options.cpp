// config/vio.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_slam/ros/vio_ros_options.h>
#include <pi_slam/vio_options_yaml.h>
#include <yaml-cpp/yaml.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_slam
{
namespace
{

using XmlRpc::XmlRpcValue;

/// As rosparam puts a YAML file on the parameter server.
XmlRpcValue fromYaml(const YAML::Node& node)
{
  XmlRpcValue value;
  if (node.IsMap())
  {
    for (const auto& member : node)
    {
      value[member.first.as<std::string>()] = fromYaml(member.second);
    }
  }
  else if (node.IsSequence())
  {
    value.setSize(static_cast<int>(node.size()));
    for (size_t i = 0; i < node.size(); ++i)
    {
      value[static_cast<int>(i)] = fromYaml(node[i]);
    }
  }
  else if (bool flag; node.Tag() != "!" && YAML::convert<bool>::decode(node, flag))
  {
    value = flag;
  }
  else if (int number; node.Tag() != "!" && YAML::convert<int>::decode(node, number))
  {
    value = number;
  }
  else if (double real; node.Tag() != "!" && YAML::convert<double>::decode(node, real))
  {
    value = real;
  }
  else
  {
    value = node.as<std::string>();
  }
  return value;
}

VioRosOptions load(const std::string& yaml, std::vector<std::string>* unknown)
{
  return VioRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/vio/", unknown);
}

std::string refusal(const std::string& yaml)
{
  std::vector<std::string> unknown;
  try
  {
    load(yaml, &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

void collectNames(XmlRpcValue tree, const std::string& path, std::set<std::string>* names)
{
  for (auto& [name, value] : tree)
  {
    if (value.getType() == XmlRpcValue::TypeStruct)
    {
      collectNames(value, path + name + "/", names);
    }
    else
    {
      names->insert(path + name);
    }
  }
}

TEST(VioRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpcValue yaml = fromYaml(YAML::LoadFile(VIO_YAML));
  std::vector<std::string> unknown;
  const VioRosOptions options = VioRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(VioRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(VioRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(VioRosOptions, ParametersComeBackAsTheyWere)
{
  VioRosOptions options;
  options.vio.tracker.max_features = 99;
  options.mapper.max_keyframes = 77;
  options.calibration.source = CalibrationSource::KALIBR;
  options.calibration.camchain = "camchain.yaml";
  options.calibration.imu_in_base = {1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0};
  options.tf_rate_hz = 10.0;
  std::vector<std::string> unknown;
  const VioRosOptions again = VioRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(VioRosOptions().toText(), again.toText());
}

TEST(VioRosOptions, WholeNumbersAreNumbersToo)
{
  std::vector<std::string> unknown;
  EXPECT_EQ(20.0, load("{tf_rate_hz: 20, calibration: {imu_in_base: [1, 0, 0, 0, 0, 0, 1]}}", &unknown).tf_rate_hz);
}

TEST(VioRosOptions, NamesUnknownParameters)
{
  std::vector<std::string> unknown;
  load("{tracker: {max_feature: 10}, queue: 3}", &unknown);
  EXPECT_EQ((std::vector<std::string>{"/vio/queue", "/vio/tracker/max_feature"}), unknown);
}

TEST(VioRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /vio/queue_size = 0, must be in [1, 1000]", refusal("queue_size: 0"));
  EXPECT_EQ("parameter /vio/tf_rate_hz = -1, must be in [0, 4000]", refusal("tf_rate_hz: -1"));
  EXPECT_EQ("parameter /vio/tf_rate_hz = nan, must be in [0, 4000]", refusal("tf_rate_hz: .nan"));
  EXPECT_EQ("parameter /vio/pair_wait_s = 0.001, must be above pair_tolerance_s, up to 2",
            refusal("pair_wait_s: 0.001"));
  EXPECT_EQ("parameter /vio/odom_frame = \"/odom\", must be a frame name without leading /",
            refusal("odom_frame: /odom"));
  EXPECT_EQ(
      "parameter /vio/odom_frame = \"map\", must be another frame than map_frame and base_link_frame, which "
      "differ too",
      refusal("odom_frame: map"));
  EXPECT_EQ("parameter /vio/publish_tf = 1, must be true or false", refusal("publish_tf: 1"));
  EXPECT_EQ("parameter /vio/calibration/source = \"yaml\" is unknown, must be camera_info, kalibr or euroc",
            refusal("calibration: {source: yaml}"));
  EXPECT_EQ("parameter /vio/map_file = \"/a.map\", must be empty with mapping = false",
            refusal("{map_file: /a.map, mapping: false}"));
  EXPECT_EQ("parameter /vio/map/max_keyframes = -5, must be at least 0", refusal("map: {max_keyframes: -5}"));
  // Bounds of the core come under their names as well.
  EXPECT_EQ(0u, refusal("tracker: {levels: 0}").find("parameter /vio/tracker/levels = 0"))
      << refusal("tracker: {levels: 0}");
}

}  // namespace
}  // namespace pi_slam
