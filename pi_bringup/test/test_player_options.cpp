// config/default.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_bringup/ros/euroc_player_ros.h>
#include <pi_bringup/ros/video_player_ros.h>

#include <fstream>
#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

using pi_bringup::EurocPlayerOptions;
using pi_bringup::VideoPlayerOptions;

namespace
{

std::string text(const std::string& value)
{
  return value;
}
std::string text(bool value)
{
  return value ? "true" : "false";
}
std::string text(double value)
{
  std::ostringstream stream;
  stream << value;
  return stream.str();
}
std::string text(const std::vector<double>& values)
{
  std::string result;
  for (const double value : values)
  {
    result += text(value) + " ";
  }
  return result;
}

std::string text(const cv::FileNode& node)
{
  if (node.isSeq())
  {
    std::string result;
    for (const cv::FileNode& element : node)
    {
      result += text(element) + " ";
    }
    return result;
  }
  return node.isString() ? node.string() : text(node.real());
}

/// The parameters of one player in config/default.yaml as text.
std::map<std::string, std::string> yamlDefaults(const std::string& player)
{
  std::ifstream file(DEFAULT_YAML);
  std::string content = "%YAML:1.0\n---\n";
  std::string line;
  while (std::getline(file, line))
  {
    content += line.substr(0, line.find(" #")) + "\n";  // OpenCV would take the comment for part of a text
  }
  const cv::FileStorage storage(content, cv::FileStorage::READ | cv::FileStorage::MEMORY);
  std::map<std::string, std::string> defaults;
  const cv::FileNode section = storage[player];
  for (const cv::FileNode& node : section)
  {
    defaults[node.name()] = text(node);
  }
  return defaults;
}

template <typename Options>
std::string error(Options options, const std::function<void(Options*)>& change)
{
  change(&options);
  try
  {
    options.validate();
  }
  catch (const std::invalid_argument& exception)
  {
    return exception.what();
  }
  return "";
}

}  // namespace

TEST(EurocPlayerOptions, HaveTheDefaultsOfTheYaml)
{
  const EurocPlayerOptions options;
  const std::map<std::string, std::string> expected = {
      {"folder", text(options.folder)},
      {"rate", text(options.rate)},
      {"loop", text(options.loop)},
      {"start_at_first_image", text(options.timeline.start_at_first_image)},
      {"start_s", text(options.timeline.start_s)},
      {"duration_s", text(options.timeline.duration_s)},
      {"map_frame", text(options.frames.map_frame)},
      {"base_link_frame", text(options.frames.base_link_frame)},
      {"imu_frame", text(options.frames.imu_frame)},
      {"left_frame", text(options.frames.left_frame)},
      {"right_frame", text(options.frames.right_frame)},
      {"body_in_base", text(options.frames.body_in_base)},
      {"publish_tf", text(options.publish_tf)},
      {"keep_stamps", text(options.keep_stamps)},
      {"stamp_at_handover", text(options.stamp_at_handover)},
      {"publish_clock", text(options.publish_clock)},
      {"clock_rate_hz", text(options.clock_rate_hz)},
      {"path_spacing_m", text(options.path_spacing_m)},
      {"queue_size", text(static_cast<double>(options.queue_size))},
      {"prefetch_depth", text(static_cast<double>(options.prefetch_depth))},
      {"exit_when_done", text(options.exit_when_done)},
      {"wait_for_subscribers", ""},
  };
  EXPECT_EQ(expected, yamlDefaults("euroc_player"));
  EXPECT_TRUE(options.wait_for_subscribers.empty());
}

TEST(VideoPlayerOptions, HaveTheDefaultsOfTheYaml)
{
  const VideoPlayerOptions options;
  const std::map<std::string, std::string> expected = {
      {"file", text(options.file)},
      {"rate", text(options.rate)},
      {"loop", text(options.loop)},
      {"duration_s", text(options.duration_s)},
      {"frame_rate_hz", text(options.frame_rate_hz)},
      {"horizontal_fov_deg", text(options.horizontal_fov_deg)},
      {"left_frame", text(options.left_frame)},
      {"stamp_at_handover", text(options.stamp_at_handover)},
      {"queue_size", text(static_cast<double>(options.queue_size))},
      {"prefetch_depth", text(static_cast<double>(options.prefetch_depth))},
      {"exit_when_done", text(options.exit_when_done)},
      {"wait_for_subscribers", ""},
  };
  EXPECT_EQ(expected, yamlDefaults("video_player"));
  EXPECT_NO_THROW(options.validate());
}

TEST(EurocPlayerOptions, NameParameterAndValueThatAreOutOfRange)
{
  EurocPlayerOptions good;
  good.folder = "/recording";
  EXPECT_NO_THROW(good.validate());
  using O = EurocPlayerOptions;
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->folder = ""; }).find("folder = \"\""));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->rate = 0.0; }).find("rate = 0.0"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->rate = std::nan(""); }).find("rate = nan"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->timeline.start_s = -1; }).find("start_s = -1"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->timeline.duration_s = -1; }).find("duration_s = -1"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->queue_size = 0; }).find("queue_size = 0"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->prefetch_depth = 0; }).find("prefetch_depth = 0"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->clock_rate_hz = 0; }).find("clock_rate_hz = 0"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->path_spacing_m = 0; }).find("path_spacing_m = 0"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->publish_clock = true; }).find("keep_stamps: true"));
  EXPECT_NE(std::string::npos,
            error<O>(good, [](O* o) { o->stamp_at_handover = o->keep_stamps = true; }).find("stamp_at_handover"));
  EXPECT_NE(std::string::npos, error<O>(good, [](O* o) { o->frames.map_frame = ""; }).find("map_frame"));
}

TEST(VideoPlayerOptions, NameParameterAndValueThatAreOutOfRange)
{
  using O = VideoPlayerOptions;
  EXPECT_NE(std::string::npos,
            error<O>({}, [](O* o) { o->horizontal_fov_deg = 180; }).find("horizontal_fov_deg = 180"));
  EXPECT_NE(std::string::npos, error<O>({}, [](O* o) { o->frame_rate_hz = -1; }).find("frame_rate_hz = -1"));
  EXPECT_NE(std::string::npos, error<O>({}, [](O* o) { o->file = ""; }).find("file"));
}
