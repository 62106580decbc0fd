#include <pi_bringup/video_reader.h>

#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>

namespace pi_bringup
{

struct VideoReader::Capture
{
  cv::VideoCapture capture;
};

VideoReader::VideoReader(const std::string& path, bool loop)
  : path_(path), loop_(loop), capture_(std::make_unique<Capture>())
{
  if (!std::filesystem::is_regular_file(path))
  {
    std::string way_out = "install the Debian package opencv-doc for the default video or name another file";
    if (std::filesystem::is_regular_file(path + ".gz"))
    {
      way_out = "there is " + path + ".gz: unpack it with gunzip and name the result";
    }
    throw std::runtime_error("video " + path + ": no such file; " + way_out);
  }
  if (!capture_->capture.open(path))
  {
    throw std::runtime_error("video " + path + ": OpenCV cannot open it; use a format that its FFmpeg build knows");
  }
  width_ = static_cast<int>(capture_->capture.get(cv::CAP_PROP_FRAME_WIDTH));
  height_ = static_cast<int>(capture_->capture.get(cv::CAP_PROP_FRAME_HEIGHT));
  const double rate = capture_->capture.get(cv::CAP_PROP_FPS);
  frame_rate_ = rate > 0.0 && rate < 1000.0 ? rate : 0.0;
  if (width_ <= 0 || height_ <= 0)
  {
    throw std::runtime_error("video " + path + ": has no picture size; the file is damaged");
  }
}

VideoReader::~VideoReader() = default;

std::optional<Frame> VideoReader::next()
{
  Frame frame;
  frame.width = width_;
  frame.height = height_;
  frame.channels = 3;
  frame.pixels.resize(static_cast<size_t>(width_) * static_cast<size_t>(height_) * 3);
  cv::Mat target(height_, width_, CV_8UC3, frame.pixels.data());
  cv::Mat image;
  if (!capture_->capture.read(image))
  {
    if (!loop_ || frames_this_lap_ == 0)
    {
      return std::nullopt;
    }
    frames_this_lap_ = 0;
    // Reopened rather than rewound: some containers cannot seek to frame 0 exactly.
    if (!capture_->capture.open(path_) || !capture_->capture.read(image))
    {
      return std::nullopt;
    }
  }
  ++frames_this_lap_;
  if (image.cols != width_ || image.rows != height_ || (image.type() != CV_8UC3 && image.type() != CV_8UC1))
  {
    frame = Frame();
    frame.error = path_ + ": frame " + std::to_string(frames_this_lap_) + " has another size or format";
    return frame;
  }
  if (image.channels() == 1)
  {
    cv::cvtColor(image, target, cv::COLOR_GRAY2BGR);
  }
  else
  {
    image.copyTo(target);
  }
  return frame;
}

}  // namespace pi_bringup
