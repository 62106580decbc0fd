#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

namespace pi_vehicle
{

struct VideoOptions
{
  std::string device;                 ///< of V4L2, a video file, or a sequence of pictures, as /path/of/%06d.png
  std::string pixel_format = "MJPG";  ///< four letters of V4L2
  int width = 1280;                   ///< of a picture of the device [px]
  int height = 480;                   ///< likewise [px]
  double frame_rate = 60.0;           ///< of the device, and of a sequence of pictures [Hz]
};

struct VideoPicture
{
  cv::Mat picture;        ///< 8 bits, 1, 3 (BGR) or 4 (BGRA) channels; empty: it could not be decoded
  int64_t stamp_ns = 0;   ///< when it was taken, by monotonicNs()
  bool by_driver = true;  ///< false: the driver's time is not credible; the stamp is that of the arrival
};

/// Device, what is wrong, the way out.
class VideoError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// When the driver says that it took a picture.
/// @param driver_ms  of CLOCK_MONOTONIC. @param now_ns, last_ns  of monotonicNs(): the arrival; the picture before.
/// @return nullopt if the time is in the future, over a second ago, or not after that of the picture before.
std::optional<int64_t> captureTime(double driver_ms, int64_t now_ns, int64_t last_ns);

/// A camera of V4L2, or a recorded video, which is played once at its own rate. Recordings begin at a full second of
/// the monotonic clock, so that two of one rate are in step. Not thread safe.
class VideoSource
{
public:
  /// @throws VideoError if the device is not there, not permitted, or no camera or video.
  explicit VideoSource(const VideoOptions& options);

  /// Waits for the next picture: of a camera that stalls up to 10 s. @return nullopt: the camera is gone, or the
  /// recording has ended.
  std::optional<VideoPicture> read();

  bool isRecording() const { return is_recording_; }
  double frameRate() const { return frame_rate_; }
  /// "camera /dev/video0: 1280x480 MJPG, 60.0 Hz"
  std::string text() const;
  /// Whether the camera gives what was asked for.
  bool asAsked() const;

private:
  int64_t stamp();

  const VideoOptions options_;
  const bool is_recording_;
  cv::VideoCapture capture_;
  double frame_rate_ = 0.0;
  cv::Size size_;
  std::string pixel_format_;
  int64_t begin_ns_ = 0;  ///< of a recording
  int64_t pictures_ = 0;
  int64_t last_ns_ = 0;
};

/// Called on the thread of the reader. They must not throw.
struct VideoEvents
{
  std::function<void(VideoPicture)> picture;
  std::function<void(const VideoSource&)> opened;  ///< before its first picture that could be decoded
  /// Once until opened() or another problem. @param error  false: a recording has ended, and begins again.
  std::function<void(const std::string& problem, bool error)> closed;
};

/// Reads a device on a thread of its own, and opens it again and again while it is not there.
class VideoReader
{
public:
  VideoReader(const VideoOptions& options, double reconnect_pause_s, VideoEvents events);
  /// Waits for the end of VideoSource::read().
  ~VideoReader();
  VideoReader(const VideoReader&) = delete;
  VideoReader& operator=(const VideoReader&) = delete;

private:
  void run();

  const VideoOptions options_;
  const double reconnect_pause_s_;
  const VideoEvents events_;
  std::atomic<bool> stopping_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  std::thread thread_;
};

}  // namespace pi_vehicle
