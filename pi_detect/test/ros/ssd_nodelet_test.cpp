// Judge of ssd_nodelet.test.

#include "detector/tiny_network.h"
#include "ros/pictures_on_graph.h"

#include <gtest/gtest.h>
#include <pi_detect/DetectObjects.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/SetModel.h>
#include <pi_detect/Track2DArray.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>

#include <algorithm>
#include <string>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

/// A nodelet with a tiny network.
class SsdNodelet : public testing::Test
{
protected:
  void SetUp() override
  {
    const std::string model = writeTinyNetwork(folder_.path());
    ros::param::set("/ssd/model", model);
    ros::param::set("/ssd/diagnostic_period", 0.1);
    ros::param::set("/ssd/tracker/confirm_hits", 2);
    ASSERT_TRUE(loadNodelet("/ssd", "pi_detect/ssd"));
    loaded_ = true;
    Collector<LabelArray> labels("labels");  // latched, once the model is loaded
    ASSERT_TRUE(labels.waitFor([](const LabelArray& array) { return array.model == "tiny"; })) << log_.text();
    EXPECT_EQ((std::vector<int64_t>{1, 2}), labels.last()->ids);
    EXPECT_EQ((std::vector<std::string>{"bright", "dark"}), labels.last()->names);
  }
  void TearDown() override
  {
    if (loaded_)
    {
      EXPECT_TRUE(unloadNodelet("/ssd"));
    }
    ros::param::del("/ssd");
  }

  bool isListenedTo()
  {
    return until(TIMEOUT_S, [this] { return camera_.listeners() > 0; });
  }

  TemporaryFolder folder_;
  LogCollector log_;
  CameraOnGraph camera_;
  bool loaded_ = false;
};

TEST_F(SsdNodelet, FindsObjectsWhereTheyAre)
{
  Collector<Detection2DArray> detections("detections");
  ASSERT_TRUE(isListenedTo());
  const ros::Time stamp = camera_.show(2, 1);
  ASSERT_TRUE(detections.waitForStamp(stamp)) << log_.text();
  const auto array = detections.last();
  EXPECT_EQ("camera_optical", array->header.frame_id);
  ASSERT_EQ(1u, array->detections.size());
  const Detection2D& detection = array->detections[0];
  EXPECT_EQ(stamp, detection.header.stamp);
  ASSERT_EQ(1u, detection.results.size());
  EXPECT_EQ(1, detection.results[0].id);
  EXPECT_GT(detection.results[0].score, 0.9);
  EXPECT_NEAR(2.5 * CELL_PX, detection.bbox.center.x, 1.0);
  EXPECT_NEAR(1.5 * CELL_PX, detection.bbox.center.y, 1.0);
  EXPECT_NEAR(CELL_PX, detection.bbox.size_x, 1.0);
  EXPECT_NEAR(CELL_PX, detection.bbox.size_y, 1.0);
}

TEST_F(SsdNodelet, FollowsObjects)
{
  Collector<Track2DArray> tracks("tracks");
  ASSERT_TRUE(isListenedTo());
  int64_t id = 0;
  for (int i = 0; i < 5; ++i)
  {
    const ros::Time stamp = camera_.show(1, 2);
    ASSERT_TRUE(tracks.waitForStamp(stamp)) << log_.text();
    const auto array = tracks.last();
    if (i >= 2)
    {
      ASSERT_EQ(1u, array->tracks.size());
      id = i == 2 ? array->tracks[0].id : id;
      EXPECT_EQ(id, array->tracks[0].id);
      EXPECT_EQ("bright", array->tracks[0].label);
      EXPECT_EQ(ros::Duration(0.0), array->tracks[0].since_seen);
      EXPECT_NEAR(1.5 * CELL_PX, array->tracks[0].bbox.center.x, 3.0);
    }
  }
}

TEST_F(SsdNodelet, DrawsWhatItFindsWhileSomebodyLooks)
{
  Collector<sensor_msgs::Image> overlay("overlay");
  ASSERT_TRUE(isListenedTo());
  const ros::Time stamp = camera_.show(2, 2);
  ASSERT_TRUE(overlay.waitForStamp(stamp)) << log_.text();
  const auto image = overlay.last();
  EXPECT_EQ("bgr8", image->encoding);
  EXPECT_EQ(SIDE_PX, image->width);
  // The box's left edge, below its caption, is coloured; the picture is grey.
  const uint8_t* const pixel = &image->data[(3 * CELL_PX - 4) * image->step + 3 * (2 * CELL_PX)];
  EXPECT_FALSE(pixel[0] == pixel[1] && pixel[1] == pixel[2])
      << int(pixel[0]) << " " << int(pixel[1]) << " " << int(pixel[2]);
}

TEST_F(SsdNodelet, AnswersCallsWithoutListeners)
{
  DetectObjects call;
  call.request.image = *makePicture(camera_.nextStamp(), 0, 3);
  ASSERT_TRUE(ros::service::call("/detect", call));
  EXPECT_TRUE(call.response.success) << call.response.message;
  EXPECT_EQ("camera_optical", call.response.detections.header.frame_id);
  ASSERT_EQ(1u, call.response.detections.detections.size());
  EXPECT_NEAR(0.5 * CELL_PX, call.response.detections.detections[0].bbox.center.x, 1.0);
  EXPECT_EQ(0u, camera_.listeners());

  call.request.image.data.resize(10);
  ASSERT_TRUE(ros::service::call("/detect", call));
  EXPECT_FALSE(call.response.success);
  EXPECT_NE(std::string::npos, std::string(call.response.message).find("need more than its 10 bytes"));
}

TEST_F(SsdNodelet, TellsWhatItDoes)
{
  DiagnosticCollector diagnostics;
  Collector<Detection2DArray> detections("detections");
  ASSERT_TRUE(isListenedTo());
  ASSERT_TRUE(detections.waitForStamp(camera_.show(0, 0)));
  EXPECT_TRUE(diagnostics.waitForSummary("detection", 0, "tiny, ")) << diagnostics.text();
  EXPECT_TRUE(diagnostics.waitForValue("detection", "pictures worked on", "1")) << diagnostics.text();
  EXPECT_TRUE(diagnostics.waitForValue("detection", "target used", "cpu")) << diagnostics.text();
  EXPECT_TRUE(diagnostics.waitForStatus("detection",
                                        [](const diagnostic_msgs::DiagnosticStatus& status)
                                        {
                                          return std::any_of(status.values.begin(), status.values.end(),
                                                             [](const diagnostic_msgs::KeyValue& pair) {
                                                               return pair.key == "runtime" &&
                                                                      pair.value.find("reserved") != std::string::npos;
                                                             });
                                        }))
      << diagnostics.text();
  EXPECT_TRUE(diagnostics.waitFor([](const diagnostic_msgs::DiagnosticArray& array)
                                  { return array.status[0].hardware_id == "tiny"; }));
}

TEST_F(SsdNodelet, CanBeUnloadedInFullWorkAndLoadedAgain)
{
  for (int round = 0; round < 2; ++round)
  {
    {
      Collector<Detection2DArray> detections("detections");
      ASSERT_TRUE(isListenedTo());
      EXPECT_TRUE(until(TIMEOUT_S,
                        [&]
                        {
                          camera_.show(1, 1);
                          return detections.last() != nullptr;
                        }))
          << log_.text();
      for (int i = 0; i < 20; ++i)
      {
        camera_.show(1, 1);
      }
      ASSERT_TRUE(unloadNodelet("/ssd"));
      loaded_ = false;
      EXPECT_TRUE(until(TIMEOUT_S, [this] { return camera_.listeners() == 0; }));
    }
    if (round == 0)
    {
      SetUp();
    }
  }
}

TEST(SsdNodeletParameters, ThatAreWrongAreRefusedByName)
{
  LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  ros::param::set("/wrong/max_detections", 0);
  EXPECT_FALSE(loadNodelet("/wrong", "pi_detect/ssd"));
  EXPECT_TRUE(log.waitForText("parameter /wrong/max_detections = 0")) << log.text();
  ros::param::set("/wrong_too/image_transport", "pigeon");
  EXPECT_FALSE(loadNodelet("/wrong_too", "pi_detect/ssd"));
  EXPECT_TRUE(log.waitForText("parameter /wrong_too/image_transport = \"pigeon\", must be one that is installed: raw"))
      << log.text();
}

}  // namespace
}  // namespace pi_detect

int main(int argc, char** argv)
{
  return pi_detect::runOnGraph(argc, argv, "ssd_nodelet_test");
}
