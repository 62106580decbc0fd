// Judge of ssd_lazy.test.

#include "ros/pictures_on_graph.h"

#include <gtest/gtest.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_node/test_support/on_graph.h>

#include <fstream>
#include <iterator>
#include <memory>
#include <string>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;

TEST(SsdLazy, SubscribesPicturesOnlyWhileSomebodyListens)
{
  CameraOnGraph camera;
  DiagnosticCollector diagnostics;
  const auto listens = [&camera](uint32_t number)
  { return until(TIMEOUT_S, [&camera, number] { return camera.listeners() == number; }); };
  ASSERT_TRUE(diagnostics.waitForSummary("ssd: input", OK, "nobody listens, /image is not subscribed"))
      << diagnostics.text();
  EXPECT_EQ(0u, camera.listeners());
  {
    const Collector<Detection2DArray> detections("detections");
    EXPECT_TRUE(listens(1)) << diagnostics.text();
    const Collector<Track2DArray> tracks("tracks");
    ASSERT_TRUE(tracks.waitForPublisher());
    EXPECT_EQ(1u, camera.listeners());
  }
  EXPECT_TRUE(listens(0)) << diagnostics.text();
  {
    const Collector<sensor_msgs::Image> overlay("overlay");
    EXPECT_TRUE(listens(1)) << diagnostics.text();
  }
  EXPECT_TRUE(listens(0)) << diagnostics.text();
  diagnostics.clear();
  EXPECT_TRUE(diagnostics.waitForSummary("ssd: input", OK, "nobody listens")) << diagnostics.text();
}

TEST(SsdLazy, SubscribesPicturesAlwaysIfAskedTo)
{
  ros::Publisher camera = ros::NodeHandle().advertise<sensor_msgs::Image>("/always/image", 1);
  EXPECT_TRUE(until(TIMEOUT_S, [&camera] { return camera.getNumSubscribers() == 1; }));
}

TEST(SsdNode, LoadsNoOpenClDriverOnTheCpu)
{
  const ros::Publisher camera = ros::NodeHandle().advertise<sensor_msgs::Image>("/always/image", 1);
  const Collector<Detection2DArray> detections("/always/detections");
  ASSERT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      camera.publish(makePicture(ros::Time::now(), 0, 0));
                      return detections.count() > 0;
                    }));
  std::ifstream file("/proc/" + std::to_string(processOf("/always/always")) + "/maps");
  const std::string maps{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  EXPECT_NE(std::string::npos, maps.find("libopencv_dnn")) << "these are not the node's";
  EXPECT_EQ(std::string::npos, maps.find("pocl"));
  EXPECT_EQ(std::string::npos, maps.find("libLLVM"));
}

}  // namespace
}  // namespace pi_detect

int main(int argc, char** argv)
{
  return pi_detect::runOnGraph(argc, argv, "ssd_lazy_test");
}
