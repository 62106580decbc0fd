// Judge of coordinator_faults.test.

#include "coordinator_on_graph.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <string>

namespace pi_offload
{
namespace
{

constexpr char NODELET[] = "/loaded/coordinator";

/// Loads the nodelet with one parameter. @return true if it is loaded.
template <typename Value>
bool loadWith(const std::string& parameter, const Value& value)
{
  ros::param::del(NODELET);
  ros::param::set(std::string(NODELET) + "/" + parameter, value);
  return loadNodelet(NODELET, "pi_offload/coordinator");
}

TEST(CoordinatorFaults, WhatCannotBeUsedIsNamedAndNothingIsLoaded)
{
  LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  EXPECT_FALSE(loadWith("policy/name", "best"));
  EXPECT_TRUE(log.waitForText("parameter /loaded/coordinator/policy/name = \"best\", must be one of ")) << log.text();
  EXPECT_FALSE(loadWith("nodes_file", "/no/such/map.yaml"));
  EXPECT_TRUE(log.waitForText("/no/such/map.yaml: cannot be read; it must be a YAML file with a list nodes"))
      << log.text();
  const TemporaryFolder folder;
  const std::string map = folder.file("map.yaml", "nodes: [{id: lamp, address: 'h'}]");
  EXPECT_FALSE(loadWith("nodes_file", map));
  EXPECT_TRUE(log.waitForText(map + ": node 1: ")) << log.text();
  EXPECT_FALSE(loadWith("detection/deadline_s", -1.0));
  EXPECT_TRUE(log.waitForText("parameter /loaded/coordinator/detection/deadline_s = -1, must be in ")) << log.text();
}

TEST(CoordinatorFaults, ANodeletIsLoadedWorksAndIsUnloaded)
{
  FakeDetector detector("loaded");
  LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  ASSERT_TRUE(loadWith("polcy", "local")) << log.text();
  EXPECT_TRUE(log.waitForText("parameter /loaded/coordinator/polcy means nothing here")) << log.text();
  {
    ros::Publisher camera = ros::NodeHandle("/loaded").advertise<sensor_msgs::Image>("image", 10);
    const Collector<pi_detect::Detection2DArray> detections("/loaded/detections");
    ASSERT_TRUE(until(TIMEOUT_S, [&] { return camera.getNumSubscribers() == 1 && detector.listeners() == 1; }));
    sensor_msgs::Image image;
    image.header.stamp = ros::Time::now();
    image.encoding = "mono8";
    image.width = image.height = image.step = 8;
    image.data.assign(64, 1);
    camera.publish(image);
    EXPECT_TRUE(detections.waitForStamp(image.header.stamp)) << log.text();
  }
  EXPECT_TRUE(unloadNodelet(NODELET));
  EXPECT_FALSE(ros::service::exists("/loaded/coordinator/decide", false));
}

TEST(CoordinatorFaults, TheLaunchFileStartsItWithItsMapFile)
{
  const std::string service = "/launched/coordinator/nodes";
  ASSERT_TRUE(ros::service::waitForService(service, ros::Duration(TIMEOUT_S)));
  Nodes nodes;
  ASSERT_TRUE(ros::service::call(service, nodes));
  ASSERT_EQ(3u, nodes.response.nodes.size());
  EXPECT_EQ("gate", nodes.response.nodes[0].node.id);
  EXPECT_FALSE(nodes.response.nodes[0].connected);
}

}  // namespace
}  // namespace pi_offload

int main(int argc, char** argv)
{
  return pi_offload::runOnGraph(argc, argv, "coordinator_faults_test");
}
