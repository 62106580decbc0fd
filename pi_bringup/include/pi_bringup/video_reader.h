#pragma once

#include <pi_bringup/frame_prefetcher.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

namespace pi_bringup
{

/// Frames of a video file in order, decoded by OpenCV. One thread at a time.
class VideoReader
{
public:
  /// @param loop start again at the end, for ever.
  /// @throws std::runtime_error if the file is missing or OpenCV cannot decode its first frame; names the way out.
  VideoReader(const std::string& path, bool loop);
  ~VideoReader();

  int width() const { return width_; }              ///< [px]
  int height() const { return height_; }            ///< [px]
  double frameRate() const { return frame_rate_; }  ///< as the file says [Hz]; 0 if it does not

  /// The next frame, blue-green-red; nullopt at the end.
  std::optional<Frame> next();

private:
  struct Capture;

  const std::string path_;
  const bool loop_;
  std::unique_ptr<Capture> capture_;
  int width_ = 0;
  int height_ = 0;
  double frame_rate_ = 0.0;
  size_t frames_this_lap_ = 0;
};

}  // namespace pi_bringup
