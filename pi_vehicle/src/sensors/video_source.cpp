#include "sensors/video_source.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <utility>

namespace pi_vehicle
{

using pi_node::format;
using pi_node::monotonicNs;

namespace
{

constexpr int64_t SECOND_NS = 1'000'000'000;
constexpr double SLOWEST_RECORDING_HZ = 1.0;

/// Whether it is no device. One that is not there is taken for a device below /dev.
bool isRecordingPath(const std::string& path)
{
  struct stat status = {};
  return ::stat(path.c_str(), &status) == 0 ? !S_ISCHR(status.st_mode) : path.rfind("/dev/", 0) != 0;
}

bool isSequence(const std::string& path)
{
  return path.find('%') != std::string::npos;
}

[[noreturn]] void failToOpen(const std::string& path, bool is_recording)
{
  if (::access(path.c_str(), is_recording ? R_OK : R_OK | W_OK) == 0)
  {
    throw VideoError(is_recording ? "recording " + path + " is no video that OpenCV can read"
                                  : "camera " + path +
                                        " is in use, or no camera: v4l2-ctl --list-devices shows those "
                                        "that are");
  }
  const int error = errno;
  if (is_recording && isSequence(path))
  {
    throw VideoError("recording " + path + " has no first picture; its number must be 0 or 1, or follow the names");
  }
  throw VideoError((is_recording ? "recording " : "camera ") + path +
                   (error == EACCES
                        ? " may not be opened by this user; add the user to the group video and log in again"
                    : error == ENOENT && !is_recording ? " is not there; is it plugged in?"
                                                       : std::string(": ") + std::strerror(error)));
}

}  // namespace

std::optional<int64_t> captureTime(double driver_ms, int64_t now_ns, int64_t last_ns)
{
  constexpr double LONGEST_MS = 1e12;  // that int64_t holds in nanoseconds
  if (!(std::abs(driver_ms) < LONGEST_MS))
  {
    return std::nullopt;
  }
  const int64_t stamp_ns = std::llround(1e6 * driver_ms);
  const bool credible = stamp_ns <= now_ns && stamp_ns >= now_ns - SECOND_NS && stamp_ns > last_ns;
  return credible ? std::optional<int64_t>(stamp_ns) : std::nullopt;
}

VideoSource::VideoSource(const VideoOptions& options)
  : options_(options), is_recording_(isRecordingPath(options.device)), pixel_format_(options.pixel_format)
{
  const int backend = !is_recording_ ? cv::CAP_V4L2 : isSequence(options.device) ? cv::CAP_IMAGES : cv::CAP_FFMPEG;
  // OpenCV itself would write a warning at each try.
  const bool is_there = isSequence(options.device) || ::access(options.device.c_str(), F_OK) == 0;
  if (!is_there || !capture_.open(options.device, backend))
  {
    failToOpen(options.device, is_recording_);
  }
  if (!is_recording_)
  {
    const std::string& letters = options.pixel_format;
    capture_.set(cv::CAP_PROP_FOURCC, cv::VideoWriter::fourcc(letters[0], letters[1], letters[2], letters[3]));
    capture_.set(cv::CAP_PROP_FRAME_WIDTH, options.width);
    capture_.set(cv::CAP_PROP_FRAME_HEIGHT, options.height);
    capture_.set(cv::CAP_PROP_FPS, options.frame_rate);
    const auto fourcc = static_cast<uint32_t>(capture_.get(cv::CAP_PROP_FOURCC));
    pixel_format_.assign({static_cast<char>(fourcc), static_cast<char>(fourcc >> 8), static_cast<char>(fourcc >> 16),
                          static_cast<char>(fourcc >> 24)});
  }
  size_ = cv::Size(static_cast<int>(capture_.get(cv::CAP_PROP_FRAME_WIDTH)),
                   static_cast<int>(capture_.get(cv::CAP_PROP_FRAME_HEIGHT)));
  if (isSequence(options.device) && size_.empty())  // a single picture is opened by OpenCV 4.10, and never read
  {
    throw VideoError("recording " + options.device +
                     ": its first picture cannot be decoded, or is the only one, which OpenCV " +
                     cv::getVersionString() + " does not play");
  }
  frame_rate_ = isSequence(options.device) ? options.frame_rate : capture_.get(cv::CAP_PROP_FPS);
  if (!(frame_rate_ >= SLOWEST_RECORDING_HZ && frame_rate_ <= 1000.0))
  {
    frame_rate_ = options.frame_rate;
  }
}

std::string VideoSource::text() const
{
  return (is_recording_ ? "recording " : "camera ") + options_.device + ": " +
         pi_node::sizeText(size_.width, size_.height) + (is_recording_ ? "" : " " + pixel_format_) +
         format(", %.1f Hz", frame_rate_);
}

bool VideoSource::asAsked() const
{
  return is_recording_ ||
         (size_ == cv::Size(options_.width, options_.height) && pixel_format_ == options_.pixel_format &&
          std::abs(frame_rate_ - options_.frame_rate) < 0.05 * options_.frame_rate);
}

std::optional<VideoPicture> VideoSource::read()
{
  VideoPicture result;
  if (is_recording_ && begin_ns_ == 0)
  {
    begin_ns_ = (monotonicNs() / SECOND_NS + 1) * SECOND_NS;
  }
  if (!capture_.grab())
  {
    return std::nullopt;
  }
  if (is_recording_)
  {
    result.stamp_ns = begin_ns_ + std::llround(1e9 * static_cast<double>(pictures_) / frame_rate_);
    const int64_t late_ns = monotonicNs() - result.stamp_ns;
    if (late_ns > std::llround(1e9 / frame_rate_))  // the computer is too slow: the rest comes later
    {
      begin_ns_ += late_ns;
      result.stamp_ns += late_ns;
    }
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::max<int64_t>(0, -late_ns)));
  }
  else
  {
    const int64_t now_ns = monotonicNs();
    const std::optional<int64_t> taken_ns = captureTime(capture_.get(cv::CAP_PROP_POS_MSEC), now_ns, last_ns_);
    result.by_driver = taken_ns.has_value();
    result.stamp_ns = taken_ns.value_or(now_ns);
  }
  ++pictures_;
  last_ns_ = result.stamp_ns;
  try
  {
    if (!capture_.retrieve(result.picture) || result.picture.depth() != CV_8U)
    {
      result.picture.release();
    }
  }
  catch (const cv::Exception&)
  {
    result.picture.release();
  }
  return result;
}

VideoReader::VideoReader(const VideoOptions& options, double reconnect_pause_s, VideoEvents events)
  : options_(options), reconnect_pause_s_(reconnect_pause_s), events_(std::move(events))
{
  thread_ = std::thread([this] { run(); });
  pthread_setname_np(thread_.native_handle(), "camera");
}

VideoReader::~VideoReader()
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void VideoReader::run()
{
  std::string told;
  while (!stopping_)
  {
    std::string problem;
    bool error = true;
    try
    {
      VideoSource source(options_);
      bool any = false;
      std::optional<VideoPicture> picture;
      while (!stopping_ && (picture = source.read()))
      {
        if (!any && !picture->picture.empty())
        {
          any = true;
          told.clear();
          events_.opened(source);
        }
        events_.picture(std::move(*picture));
      }
      error = !source.isRecording() || !any;
      problem = (source.isRecording() ? "recording " : "camera ") + options_.device +
                (!source.isRecording() ? " gives no pictures any more; is it unplugged?"
                 : any                 ? " has ended"
                                       : " has no picture that can be decoded");
    }
    catch (const VideoError& failure)
    {
      problem = failure.what();
    }
    if (!stopping_ && std::exchange(told, problem) != problem)
    {
      events_.closed(problem, error);
    }
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait_for(lock, std::chrono::duration<double>(reconnect_pause_s_), [this] { return stopping_.load(); });
  }
}

}  // namespace pi_vehicle
