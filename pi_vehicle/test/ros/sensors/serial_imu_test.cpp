// Judge of serial_imu.test.

#include "sensors/fake_vectornav.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <ros/ros.h>
#include <sensor_msgs/Imu.h>

#include <cmath>

#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;

class SerialImuNode : public testing::Test
{
protected:
  void SetUp() override
  {
    ASSERT_TRUE(logs_.waitForNode());
    ros::param::set("/imu/port", link_);
    ros::param::set("/imu/reconnect_pause_s", 0.1);
    ros::param::set("/imu/gyro_deviation", 0.01);
    ros::param::set("/imu/accel_deviation", 0.1);
    ASSERT_TRUE(loadNodelet("/imu", "pi_vehicle/serial_imu"));
  }
  void TearDown() override
  {
    EXPECT_TRUE(unloadNodelet("/imu"));
    ros::param::del("/imu");
  }
  bool waitForMore(size_t count = 50)
  {
    return until(TIMEOUT_S, [this, most = samples_.count() + count] { return samples_.count() >= most; });
  }

  const TemporaryFolder folder_;
  const std::string link_ = folder_.path() + "/imu";
  FakeVectorNav device_{link_};
  Collector<sensor_msgs::Imu> samples_{"imu/data"};
  DiagnosticCollector diagnostics_;
  LogCollector logs_;
};

TEST_F(SerialImuNode, PublishesWhatTheDeviceMeasures)
{
  ASSERT_TRUE(waitForMore());
  const sensor_msgs::Imu imu = *samples_.last();
  EXPECT_EQ("imu_link", imu.header.frame_id);
  EXPECT_EQ(9.81, imu.linear_acceleration.z);
  EXPECT_EQ(0.003, imu.angular_velocity.z);
  EXPECT_EQ(-1.0, imu.orientation_covariance[0]) << "no orientation";
  for (const size_t i : {0, 4, 8})
  {
    EXPECT_NEAR(1e-4, imu.angular_velocity_covariance[i], 1e-12);
    EXPECT_NEAR(1e-2, imu.linear_acceleration_covariance[i], 1e-12);
  }
  EXPECT_EQ(0.0, imu.angular_velocity_covariance[1]);
  ros::Time before;
  for (const auto& sample : samples_.messages())
  {
    EXPECT_GT(sample->header.stamp, before);
    before = sample->header.stamp;
  }
  EXPECT_LT(std::abs((ros::Time::now() - before).toSec()), 5.0);
  EXPECT_TRUE(diagnostics_.waitForValue("imu: imu", "port", link_)) << diagnostics_.text();
}

TEST_F(SerialImuNode, UnpluggedItSaysSoAndGoesOnWhenItIsBack)
{
  ASSERT_TRUE(waitForMore());
  device_.unplug();
  EXPECT_TRUE(logs_.waitForText("is the IMU unplugged?; tried again until it measures")) << logs_.text();
  EXPECT_TRUE(diagnostics_.waitForStatus("imu: imu", [](const auto& status) { return status.level == ERROR; }))
      << diagnostics_.text();
  device_.plugIn();
  EXPECT_TRUE(waitForMore());
}

TEST_F(SerialImuNode, BrokenLinesAreCountedAndNothingOfThemIsPublished)
{
  ASSERT_TRUE(diagnostics_.waitForSummary("imu: imu", OK, "Hz")) << diagnostics_.text();
  std::string wrong = FakeVectorNav::measurement();
  wrong[40] = '7';
  device_.send(wrong + vectorNavCommand("VNIMU,0,0,0,0,0,nan,0,0,0,0,0"));
  EXPECT_TRUE(diagnostics_.waitForSummary("imu: imu", WARN, "2 broken and ")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForValue("imu: imu", "lines with a wrong checksum", "1")) << diagnostics_.text();
  for (const auto& sample : samples_.messages())
  {
    EXPECT_EQ(9.81, sample->linear_acceleration.z);
  }
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "serial_imu_test");
}
