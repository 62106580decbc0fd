// The YAML files and the defaults in the code must be the same, and impossible values must be named.

#include "ros/sensors/serial_imu_ros.h"
#include "ros/sensors/stereo_camera_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<SerialImuRosOptions> imu_reader("/imu/");
const OptionsReader<StereoCameraRosOptions> camera_reader("/camera/");

TEST(SensorOptions, DefaultsAreThoseOfTheYamlFiles)
{
  imu_reader.expectDefaultsOf(CONFIG_DIR "/serial_imu.yaml");
  camera_reader.expectDefaultsOf(CONFIG_DIR "/stereo_camera.yaml");
}

TEST(SensorOptions, NameParameterValueAndBound)
{
  EXPECT_EQ("parameter /imu/accel_deviation = 0, must be positive", imu_reader.refusal("accel_deviation: 0"));
  EXPECT_EQ(0u, imu_reader.refusal("port: ''").find("parameter /imu/port = \"\", must be a path"));
  EXPECT_EQ("parameter /camera/pixel_format = \"H264\", must be MJPG or YUYV",
            camera_reader.refusal("pixel_format: H264"));
  EXPECT_EQ("parameter /camera/width = 641, must be even: left and right are side by side",
            camera_reader.refusal("width: 641"));
  EXPECT_EQ("", camera_reader.refusal("{width: 641, right_device: /dev/video2}"));
  EXPECT_EQ("parameter /camera/max_time_difference_s = 0.01, must be in [1e-06, 0.00833333]",
            camera_reader.refusal("max_time_difference_s: 0.01"));
  EXPECT_NE("", camera_reader.refusal("right_device: /dev/video0"));
  EXPECT_NE("", camera_reader.refusal("device: ''"));
}

}  // namespace
}  // namespace pi_vehicle
