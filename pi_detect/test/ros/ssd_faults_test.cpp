// Judge of ssd_faults.test. The tests build on each other: the node has no model before the first that gives it one.

#include "detector/tiny_network.h"
#include "ros/pictures_on_graph.h"

#include <gtest/gtest.h>
#include <pi_detect/DetectObjects.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/SetModel.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>

#include <filesystem>
#include <memory>
#include <string>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

/// One node for all tests.
class SsdFaults : public testing::Test
{
protected:
  struct Graph
  {
    TemporaryFolder folder;
    CameraOnGraph camera;
    Collector<Detection2DArray> detections{"detections"};
    DiagnosticCollector diagnostics;
    LogCollector log;
  };

  static void SetUpTestSuite()
  {
    graph_ = std::make_unique<Graph>();
    ASSERT_TRUE(ros::service::waitForService("/set_model", ros::Duration(TIMEOUT_S)));
    ASSERT_TRUE(until(TIMEOUT_S, [] { return graph_->camera.listeners() > 0; }));
  }
  static void TearDownTestSuite() { graph_.reset(); }
  void SetUp() override
  {
    graph_->log.clear();
    graph_->diagnostics.clear();
    graph_->detections.clear();
  }

  static SetModel::Response setModel(const std::string& description)
  {
    SetModel call;
    call.request.description = description;
    EXPECT_TRUE(ros::service::call("/set_model", call));
    return call.response;
  }
  static bool contains(const std::string& text, const std::string& part)
  {
    return text.find(part) != std::string::npos;
  }
  /// A bright cell is found.
  static void expectWork()
  {
    const ros::Time stamp = graph_->camera.show(1, 1);
    ASSERT_TRUE(graph_->detections.waitForStamp(stamp)) << graph_->log.text();
    EXPECT_EQ(1u, graph_->detections.last()->detections.size());
  }
  static std::string text() { return graph_->diagnostics.text() + graph_->log.text(); }

  static std::unique_ptr<Graph> graph_;
};
std::unique_ptr<SsdFaults::Graph> SsdFaults::graph_;

TEST_F(SsdFaults, MissingModelIsAnErrorWithTheFilesName)
{
  EXPECT_TRUE(graph_->diagnostics.waitForSummary("detection", ERROR, "/no/such/model.yaml")) << text();
  DetectObjects call;
  call.request.image = *makePicture(graph_->camera.nextStamp(), 1, 1);
  ASSERT_TRUE(ros::service::call("/detect", call));
  EXPECT_FALSE(call.response.success);
  EXPECT_TRUE(contains(call.response.message, "/no/such/model.yaml")) << call.response.message;
  const SetModel::Response again = setModel("");
  EXPECT_FALSE(again.success);
  EXPECT_TRUE(contains(again.message, "/no/such/model.yaml")) << again.message;
  EXPECT_TRUE(graph_->log.waitForText("no detection until set_model is called")) << text();
}

TEST_F(SsdFaults, ModelIsTriedAgainOnceItsFileIsThere)
{
  const std::string path = graph_->folder.path() + "/tiny.yaml";
  EXPECT_FALSE(setModel(path).success);
  EXPECT_TRUE(graph_->diagnostics.waitForSummary("detection", ERROR, path)) << text();
  ASSERT_EQ(path, writeTinyNetwork(graph_->folder.path()));
  const SetModel::Response response = setModel("");
  EXPECT_TRUE(response.success) << response.message;
  EXPECT_EQ("tiny on cpu", response.message);
  expectWork();
  EXPECT_TRUE(graph_->diagnostics.waitForSummary("detection", OK, "tiny")) << text();
}

TEST_F(SsdFaults, ModelThatFailsLeavesTheEarlierOneInUse)
{
  const TemporaryFolder folder;
  const std::string path = writeTinyNetwork(folder.path());
  std::filesystem::resize_file(folder.path() + "/tiny.prototxt", 300);
  const SetModel::Response response = setModel(path);
  EXPECT_FALSE(response.success);
  EXPECT_TRUE(contains(response.message, folder.path())) << response.message;
  EXPECT_TRUE(contains(response.message, "tiny on cpu stays in use")) << response.message;
  EXPECT_TRUE(graph_->diagnostics.waitForSummary("detection", WARN, "goes on with tiny")) << text();
  expectWork();
  const SetModel::Response relative = setModel("models/tiny.yaml");
  EXPECT_FALSE(relative.success);
  EXPECT_TRUE(contains(relative.message, "must be the name of a network or an absolute path")) << relative.message;
  const SetModel::Response unknown = setModel("tiny");
  EXPECT_FALSE(unknown.success);
  EXPECT_TRUE(contains(unknown.message, "which has accurate, fast, ssd_mobilenet, street")) << unknown.message;
  EXPECT_TRUE(setModel(graph_->folder.path() + "/tiny.yaml").success);
}

TEST_F(SsdFaults, PicturesWithoutObjectsGiveEmptyArrays)
{
  const ros::Time stamp = graph_->camera.show(-1, -1);
  ASSERT_TRUE(graph_->detections.waitForStamp(stamp)) << text();
  EXPECT_TRUE(graph_->detections.last()->detections.empty());
  EXPECT_EQ("camera_optical", graph_->detections.last()->header.frame_id);
}

TEST_F(SsdFaults, PicturesThatCannotBeAreNamedAndPassOver)
{
  auto wrong = makePicture(graph_->camera.nextStamp(), 1, 1);
  wrong->data.resize(100);
  graph_->camera.publish(wrong);
  EXPECT_TRUE(graph_->log.waitForText("/image: step 128 and height 128 need more than its 100 bytes")) << text();
  wrong = makePicture(graph_->camera.nextStamp(), 1, 1);
  wrong->encoding = "jpeg";
  graph_->camera.publish(wrong);
  EXPECT_TRUE(graph_->log.waitForText("/image: encoding \"jpeg\" is no picture")) << text();
  EXPECT_TRUE(graph_->diagnostics.waitForStatus(
      "input", [](const diagnostic_msgs::DiagnosticStatus& status) { return status.level == ERROR; }))
      << text();
  expectWork();
  EXPECT_EQ(1u, graph_->detections.messages().size());
}

TEST_F(SsdFaults, PicturesWithoutStampAreUsedAndNamed)
{
  graph_->camera.publish(makePicture(ros::Time(), 1, 1));
  EXPECT_TRUE(graph_->detections.waitForStamp(ros::Time())) << text();
  EXPECT_TRUE(graph_->log.waitForText("/image: stamp is 0")) << text();
}

TEST_F(SsdFaults, SilentCameraIsNamed)
{
  EXPECT_TRUE(graph_->log.waitForText("/image: nothing for")) << text();
  EXPECT_TRUE(graph_->diagnostics.waitForSummary("input", WARN, "nothing")) << text();
}

TEST_F(SsdFaults, NewestPictureWinsInABurst)
{
  ros::Time last;
  for (int i = 0; i < 300; ++i)
  {
    last = graph_->camera.show(1, 1);
  }
  ASSERT_TRUE(graph_->detections.waitForStamp(last)) << text();
  ros::Time before;
  for (const auto& message : graph_->detections.messages())
  {
    EXPECT_LT(before, message->header.stamp);
    before = message->header.stamp;
  }
  EXPECT_EQ(last, before);
  // Each picture that came was worked on or is counted as dropped.
  const auto number = [](const diagnostic_msgs::DiagnosticStatus& status, const std::string& key)
  {
    for (const diagnostic_msgs::KeyValue& pair : status.values)
    {
      if (pair.key == key)
      {
        return std::stoul(pair.value);
      }
    }
    return 0ul;
  };
  graph_->diagnostics.clear();
  EXPECT_TRUE(graph_->diagnostics.waitFor(
      [&number](const diagnostic_msgs::DiagnosticArray& array)
      {
        unsigned long came = 0;
        unsigned long dropped = 0;
        unsigned long worked = 0;
        for (const diagnostic_msgs::DiagnosticStatus& status : array.status)
        {
          came += number(status, "pictures that came");
          dropped += number(status, "pictures dropped for newer ones");
          worked += number(status, "pictures worked on");
        }
        // Two could not be used, in the test above.
        return came == dropped + worked + 2;
      }))
      << text();
}

}  // namespace
}  // namespace pi_detect

int main(int argc, char** argv)
{
  return pi_detect::runOnGraph(argc, argv, "ssd_faults_test");
}
