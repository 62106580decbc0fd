// Judge of vio_nodelet.test.

#include "drive_on_graph.h"

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>

#include <memory>
#include <string>

namespace pi_slam
{
namespace
{

constexpr double DRIVE_S = 2.5;
constexpr double TIMEOUT_S = 15.0;

bool load(const std::string& name)
{
  nodelet::NodeletLoad request;
  request.request.name = name;
  request.request.type = "pi_slam/vio";
  return ros::service::waitForService("/manager/load_nodelet", ros::Duration(TIMEOUT_S)) &&
         ros::service::call("/manager/load_nodelet", request) && request.response.success;
}

bool unload(const std::string& name)
{
  nodelet::NodeletUnload request;
  request.request.name = name;
  return ros::service::call("/manager/unload_nodelet", request) && request.response.success;
}

TEST(VioNodelet, CanBeUnloadedInFullWorkAndLoadedAgain)
{
  DriveOnGraph drive(SyntheticDrive::make(DRIVE_S));
  Collector<nav_msgs::Odometry> odometry("odometry", 5000);
  LogCollector log;
  for (int round = 0; round < 2; ++round)
  {
    ASSERT_TRUE(load("/vio"));
    ASSERT_TRUE(drive.waitForListeners(TIMEOUT_S));
    ASSERT_TRUE(until(TIMEOUT_S, [&odometry] { return odometry.publishers() > 0; }));
    odometry.clear();
    EXPECT_TRUE(drive.playUntil(0.0, 1.0, 10.0 * round, [&odometry] { return odometry.count() > 50; }, {}))
        << log.text();
    ASSERT_TRUE(unload("/vio"));
    EXPECT_TRUE(drive.waitForNoListeners(TIMEOUT_S));
  }
}

TEST(VioNodelet, RefusesAWrongParameterByName)
{
  LogCollector log;
  ASSERT_TRUE(log.waitForNode(TIMEOUT_S));
  ros::param::set("/wrong/tracker/max_features", -1);
  EXPECT_FALSE(load("/wrong"));
  EXPECT_TRUE(log.waitForText("parameter /wrong/tracker/max_features = -1", TIMEOUT_S)) << log.text();
}

TEST(VioNodelet, RefusesACalibrationFileThatIsMissing)
{
  LogCollector log;
  ASSERT_TRUE(log.waitForNode(TIMEOUT_S));
  ros::param::set("/missing/calibration/source", "kalibr");
  ros::param::set("/missing/calibration/camchain", "/no/camchain.yaml");
  EXPECT_FALSE(load("/missing"));
  EXPECT_TRUE(log.waitForText("/no/camchain.yaml: missing or not readable", TIMEOUT_S)) << log.text();
}

}  // namespace
}  // namespace pi_slam

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "vio_nodelet_test");
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
