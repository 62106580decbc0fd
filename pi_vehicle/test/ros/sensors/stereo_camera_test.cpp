// Judge of stereo_camera.test.

#include "sensors/recorded_pictures.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <filesystem>
#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int PICTURES = 30;

/// As camera_calibration writes it.
std::string calibrationFile(int width, int height)
{
  return "image_width: " + std::to_string(width) + "\nimage_height: " + std::to_string(height) +
         "\ncamera_name: left\ndistortion_model: plumb_bob\n"
         "camera_matrix: {rows: 3, cols: 3, data: [400, 0, 16, 0, 401, 12, 0, 0, 1]}\n"
         "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}\n"
         "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
         "projection_matrix: {rows: 3, cols: 4, data: [400, 0, 16, 0, 0, 401, 12, 0, 0, 0, 1, 0]}\n";
}

class StereoCamera : public testing::Test
{
protected:
  void SetUp() override
  {
    ASSERT_TRUE(logs_.waitForNode());
    ros::param::set("/camera/diagnostic_period", 0.2);
    ros::param::set("/camera/reconnect_pause_s", 0.1);
  }
  void TearDown() override
  {
    EXPECT_TRUE(unloadNodelet("/camera"));
    ros::param::del("/camera");
  }
  void load(const std::string& device, const std::string& right_device = "")
  {
    ros::param::set("/camera/device", device);
    ros::param::set("/camera/right_device", right_device);
    ASSERT_TRUE(loadNodelet("/camera", "pi_vehicle/stereo_camera"));
  }
  std::string sequence(const std::string& name, int count = PICTURES, cv::Size size = {64, 24})
  {
    const std::string folder = folder_.path() + "/" + name;
    std::filesystem::create_directory(folder);
    return writeSequence(folder, count, size);
  }
  bool waitForPictures(size_t count = PICTURES)
  {
    return until(TIMEOUT_S, [&] { return left_.count() >= count && right_.count() >= count; });
  }
  bool summary(int level, const std::string& part)
  {
    return diagnostics_.waitForSummary("camera: camera", level, part);
  }

  const TemporaryFolder folder_;
  Collector<sensor_msgs::Image> left_{"left/image_raw"};
  Collector<sensor_msgs::Image> right_{"right/image_raw"};
  Collector<sensor_msgs::CameraInfo> left_info_{"left/camera_info"};
  Collector<sensor_msgs::CameraInfo> right_info_{"right/camera_info"};
  DiagnosticCollector diagnostics_;
  LogCollector logs_;
};

TEST_F(StereoCamera, HalvesPicturesSideBySide)
{
  load(sequence("both"));
  ASSERT_TRUE(waitForPictures());
  ros::Time before;
  for (const auto& left : left_.messages())
  {
    EXPECT_GT(left->header.stamp, before);
    before = left->header.stamp;
    EXPECT_EQ(32u, left->width);
    EXPECT_EQ(24u, left->height);
    EXPECT_EQ("bgr8", left->encoding);
    EXPECT_EQ("left_optical", left->header.frame_id);
  }
  ASSERT_TRUE(right_.waitForStamp(left_.messages()[PICTURES / 2]->header.stamp)) << "the same for both";
  for (const auto& right : right_.messages())
  {
    for (const auto& left : left_.messages())
    {
      if (left->header.stamp == right->header.stamp)
      {
        EXPECT_EQ(left->data[0] + 100, right->data[0]);
      }
    }
    EXPECT_EQ("right_optical", right->header.frame_id);
  }
  EXPECT_TRUE(left_info_.waitForStamp(left_.messages().back()->header.stamp));
  EXPECT_TRUE(summary(WARN, "camera is not calibrated; set")) << diagnostics_.text();
  EXPECT_EQ(32u, left_info_.last()->width);
  EXPECT_EQ(0.0, left_info_.last()->K[0]);
}

TEST_F(StereoCamera, ARecordingBeginsAgainAtItsEnd)
{
  load(writeVideo(folder_.path() + "/both.avi", 5, 50.0));
  ASSERT_TRUE(waitForPictures(12));
  EXPECT_TRUE(logs_.waitForText("both.avi has ended; it begins again")) << logs_.text();
}

TEST_F(StereoCamera, MakesThemGrey)
{
  ros::param::set("/camera/color", false);
  load(sequence("both"));
  ASSERT_TRUE(waitForPictures(1));
  EXPECT_EQ("mono8", left_.last()->encoding);
  EXPECT_EQ(32u * 24u, left_.last()->data.size());
  EXPECT_LT(left_.last()->data[0], PICTURES);
}

TEST_F(StereoCamera, PublishesTheCalibrationThatFits)
{
  ros::param::set("/camera/left_calibration", folder_.file("left.yaml", calibrationFile(32, 24)));
  ros::param::set("/camera/right_calibration", folder_.file("right.yaml", calibrationFile(640, 480)));
  load(sequence("both"));
  ASSERT_TRUE(waitForPictures(1));
  ASSERT_TRUE(left_info_.waitFor([](const sensor_msgs::CameraInfo& info) { return info.K[0] == 400.0; }));
  EXPECT_EQ("left_optical", left_info_.last()->header.frame_id);
  EXPECT_TRUE(summary(ERROR, "the calibration of the right camera is for 640x480, its pictures are 32x24; calibrate"))
      << diagnostics_.text();
  EXPECT_EQ(0.0, right_info_.last()->K[0]) << "nobody may compute with it";
  EXPECT_EQ(32u, right_info_.last()->width);
}

TEST_F(StereoCamera, ACalibrationThatIsMissingOrBrokenIsNamed)
{
  ros::param::set("/camera/left_calibration", folder_.path() + "/nowhere.yaml");
  ros::param::set("/camera/right_calibration", folder_.file("broken.yaml", "image_width: [no\n"));
  load(sequence("both"));
  ASSERT_TRUE(waitForPictures(1));
  EXPECT_TRUE(diagnostics_.waitForStatus("camera: camera",
                                         [](const auto& status)
                                         {
                                           std::string all;
                                           for (const auto& value : status.values)
                                           {
                                             all += value.value + "\n";
                                           }
                                           return all.find("the left camera is not calibrated") != std::string::npos &&
                                                  all.find("the right camera is not calibrated") != std::string::npos;
                                         }))
      << diagnostics_.text();
  EXPECT_TRUE(logs_.waitForText("nowhere.yaml")) << logs_.text();
}

TEST_F(StereoCamera, TwoDevicesArePaired)
{
  load(sequence("left", PICTURES, {32, 24}), sequence("right", PICTURES, {32, 24}));
  ASSERT_TRUE(waitForPictures());
  EXPECT_EQ(32u, left_.last()->width);
  ASSERT_TRUE(right_.waitForStamp(left_.messages()[0]->header.stamp)) << "recordings are in step";
  EXPECT_TRUE(diagnostics_.waitForValue("camera: camera", "time difference p99 [ms]", "0.000")) << diagnostics_.text();
}

TEST_F(StereoCamera, DevicesOutOfStepAreNamedWithTheirDifference)
{
  load(writeVideo(folder_.path() + "/left.avi", 100, 100.0), writeVideo(folder_.path() + "/right.avi", 30, 27.0));
  EXPECT_TRUE(summary(ERROR, "at most 2.0 ms pass; trigger the cameras together")) << diagnostics_.text();
}

TEST_F(StereoCamera, DevicesOfTwoSizesAreNamed)
{
  load(sequence("left", PICTURES, {32, 24}), sequence("right", PICTURES, {64, 24}));
  EXPECT_TRUE(summary(ERROR, "left pictures are 32x24, right ones 64x24; use two cameras of one kind"))
      << diagnostics_.text();
  EXPECT_EQ(0u, left_.count());
}

TEST_F(StereoCamera, AnOddWidthCannotBeHalved)
{
  load(sequence("both", PICTURES, {63, 24}));
  EXPECT_TRUE(summary(ERROR, "a picture of 63x24 cannot be halved; give a width that is even")) << diagnostics_.text();
  EXPECT_EQ(0u, left_.count());
}

TEST_F(StereoCamera, ADeviceThatComesLaterIsTakenThen)
{
  load(folder_.path() + "/both.avi");
  EXPECT_TRUE(summary(ERROR, "both.avi: No such file or directory")) << diagnostics_.text();
  EXPECT_TRUE(logs_.waitForText("No such file or directory; tried again until it is there")) << logs_.text();
  folder_.file("both.avi", "no video");
  EXPECT_TRUE(summary(ERROR, "both.avi is no video that OpenCV can read")) << diagnostics_.text();
  const std::string complete = writeVideo(folder_.path() + "/new.avi", 100, 50.0);
  std::filesystem::rename(complete, folder_.path() + "/both.avi");
  ASSERT_TRUE(waitForPictures()) << logs_.text();
  diagnostics_.clear();
  EXPECT_TRUE(diagnostics_.waitForStatus("camera: camera", [](const auto& status) { return status.level != ERROR; }))
      << diagnostics_.text();
}

TEST_F(StereoCamera, ACameraThatIsNotThereIsNamed)
{
  load("/dev/video_nowhere");
  EXPECT_TRUE(summary(ERROR, "camera /dev/video_nowhere is not there; is it plugged in?")) << diagnostics_.text();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "stereo_camera_test");
}
