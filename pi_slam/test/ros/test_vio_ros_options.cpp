// config/vio.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "odometry/vio_options_yaml.h"
#include "ros/vio_ros_options.h"

#include <string>

namespace pi_slam
{
namespace
{

using namespace pi_node::test_support;

const OptionsReader<VioRosOptions> reader("/vio/");

TEST(VioRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  reader.expectDefaultsOf(VIO_YAML);
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
  Names unknown;
  const VioRosOptions again = VioRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(VioRosOptions().toText(), again.toText());
}

TEST(VioRosOptions, WholeNumbersAreNumbersToo)
{
  Names unknown;
  EXPECT_EQ(20.0,
            reader.load("{tf_rate_hz: 20, calibration: {imu_in_base: [1, 0, 0, 0, 0, 0, 1]}}", &unknown).tf_rate_hz);
}

TEST(VioRosOptions, NamesUnknownParameters)
{
  Names unknown;
  reader.load("{tracker: {max_feature: 10}, queue: 3}", &unknown);
  EXPECT_EQ((Names{"/vio/queue", "/vio/tracker/max_feature"}), unknown);
}

TEST(VioRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /vio/queue_size = 0, must be in [1, 1000]", reader.refusal("queue_size: 0"));
  EXPECT_EQ("parameter /vio/tf_rate_hz = -1, must be in [0, 4000]", reader.refusal("tf_rate_hz: -1"));
  EXPECT_EQ("parameter /vio/tf_rate_hz = nan, must be in [0, 4000]", reader.refusal("tf_rate_hz: .nan"));
  EXPECT_EQ("parameter /vio/pair_wait_s = 0.001, must be above pair_tolerance_s, up to 2",
            reader.refusal("pair_wait_s: 0.001"));
  EXPECT_EQ("parameter /vio/odom_frame = \"/odom\", must be a frame name without leading /",
            reader.refusal("odom_frame: /odom"));
  EXPECT_EQ(
      "parameter /vio/odom_frame = \"map\", must be another frame than map_frame and base_link_frame, which "
      "differ too",
      reader.refusal("odom_frame: map"));
  EXPECT_EQ("parameter /vio/publish_tf = 1, must be true or false", reader.refusal("publish_tf: 1"));
  EXPECT_EQ("parameter /vio/calibration/source = \"yaml\", must be camera_info, kalibr or euroc",
            reader.refusal("calibration: {source: yaml}"));
  EXPECT_EQ("parameter /vio/map_file = \"/a.map\", must be empty with mapping = false",
            reader.refusal("{map_file: /a.map, mapping: false}"));
  EXPECT_EQ("parameter /vio/save_map = true, must be false without map_file", reader.refusal("save_map: true"));
  EXPECT_EQ("parameter /vio/map/max_keyframes = -5, must be at least 0", reader.refusal("map: {max_keyframes: -5}"));
  // Bounds of the core come under their names as well.
  EXPECT_EQ(0u, reader.refusal("tracker: {levels: 0}").find("parameter /vio/tracker/levels = 0"))
      << reader.refusal("tracker: {levels: 0}");
}

}  // namespace
}  // namespace pi_slam
