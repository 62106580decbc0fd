#include "sensors/video_source.h"

#include "recorded_pictures.h"

#include <gtest/gtest.h>
#include <pi_node/durations.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace pi_vehicle
{
namespace
{

using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

constexpr int64_t NOW_NS = 100'000'000'000;

std::string refusal(const std::string& device)
{
  return messageOf<VideoError>(
      [&]
      {
        VideoOptions options;
        options.device = device;
        const VideoSource source(options);
      });
}

TEST(CaptureTime, IsTheDriversWhereThatIsCredible)
{
  EXPECT_EQ(99'990'001'000, captureTime(99'990.001, NOW_NS, 0)) << "V4L2 tells microseconds";
  EXPECT_EQ(99'000'000'000, captureTime(99'000.0, NOW_NS, 0));
  EXPECT_EQ(std::nullopt, captureTime(98'999.0, NOW_NS, 0)) << "a second ago";
  EXPECT_EQ(std::nullopt, captureTime(100'000.1, NOW_NS, 0)) << "in the future";
  EXPECT_EQ(std::nullopt, captureTime(99'990.0, NOW_NS, 99'990'000'000)) << "that of the picture before";
  EXPECT_EQ(std::nullopt, captureTime(1.7e12, NOW_NS, 0)) << "since 1970";
  EXPECT_EQ(std::nullopt, captureTime(0.0, NOW_NS, 0)) << "drivers that tell none";
  EXPECT_EQ(std::nullopt, captureTime(std::nan(""), NOW_NS, 0));
  EXPECT_EQ(std::nullopt, captureTime(std::numeric_limits<double>::infinity(), NOW_NS, 0));
}

TEST(VideoSource, PlaysASequenceAtItsRate)
{
  const TemporaryFolder folder;
  VideoOptions options;
  options.device = writeSequence(folder.path(), 5);
  options.frame_rate = 50.0;
  VideoSource source(options);
  EXPECT_TRUE(source.isRecording());
  EXPECT_EQ("recording " + options.device + ": 64x24, 50.0 Hz", source.text());
  std::vector<int64_t> stamps;
  while (const auto picture = source.read())
  {
    EXPECT_EQ(0.0, cv::norm(picture->picture, numberedPicture(static_cast<int>(stamps.size()), {64, 24})));
    EXPECT_LE(picture->stamp_ns, pi_node::monotonicNs()) << "not before its time";
    stamps.push_back(picture->stamp_ns);
  }
  ASSERT_EQ(5u, stamps.size());
  EXPECT_EQ(0, stamps[0] % 1'000'000'000) << "begins with a second, in step with another recording";
  for (size_t i = 1; i < stamps.size(); ++i)
  {
    EXPECT_GE(stamps[i] - stamps[i - 1], 20'000'000);
  }
}

TEST(VideoSource, PlaysAVideoAtTheRateOfItsFile)
{
  const TemporaryFolder folder;
  VideoOptions options;
  options.device = writeVideo(folder.path() + "/video.avi", 4, 25.0);
  VideoSource source(options);
  EXPECT_EQ(25.0, source.frameRate());
  int count = 0;
  for (std::optional<VideoPicture> picture; (picture = source.read()); ++count)
  {
    EXPECT_EQ(cv::Size(64, 48), picture->picture.size());
  }
  EXPECT_EQ(4, count);
}

TEST(VideoSource, SaysWhatIsWrongAndTheWayOut)
{
  const TemporaryFolder folder;
  EXPECT_EQ("camera /dev/video_nowhere is not there; is it plugged in?", refusal("/dev/video_nowhere"));
  EXPECT_EQ("camera /dev/null is in use, or no camera: v4l2-ctl --list-devices shows those that are",
            refusal("/dev/null"));
  const std::string text = folder.file("video.avi", "this is no video");
  EXPECT_EQ("recording " + text + " is no video that OpenCV can read", refusal(text));
  EXPECT_EQ("recording " + folder.path() + " is no video that OpenCV can read", refusal(folder.path()));
  EXPECT_EQ("recording /nowhere/video.avi: No such file or directory", refusal("/nowhere/video.avi"));
  for (const char* pattern : {"/%d.png", "/%d_%d.png", "/%s", "/%"})
  {
    EXPECT_NE(std::string::npos, refusal(folder.path() + pattern).find("has no first picture")) << pattern;
  }
}

TEST(VideoSource, PicturesOf16BitsCountAsNotDecoded)
{
  const TemporaryFolder folder;
  VideoOptions options;
  options.device = writeSequence(folder.path(), 2);
  ASSERT_TRUE(cv::imwrite(folder.path() + "/0.png", cv::Mat(24, 64, CV_16UC1, cv::Scalar(1000))));
  VideoSource source(options);
  const auto picture = source.read();
  ASSERT_TRUE(picture);
  EXPECT_TRUE(picture->picture.empty());
}

TEST(VideoSource, ASinglePictureIsPlayedOrRefused)
{
  const TemporaryFolder folder;
  VideoOptions options;
  options.device = writeSequence(folder.path(), 1);
  std::optional<VideoPicture> picture;
  const std::string refused = messageOf<VideoError>([&] { picture = VideoSource(options).read(); });
  if (refused.empty())
  {
    ASSERT_TRUE(picture);
    EXPECT_EQ(cv::Size(64, 24), picture->picture.size());
  }
  else
  {
    EXPECT_EQ("recording " + options.device +
                  ": its first picture cannot be decoded, or is the only one, which OpenCV " + cv::getVersionString() +
                  " does not play",
              refused);
  }
}

}  // namespace
}  // namespace pi_vehicle
