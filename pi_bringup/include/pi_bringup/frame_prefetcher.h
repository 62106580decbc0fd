#pragma once

#include <pi_bringup/bounded_queue.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace pi_bringup
{

/// One decoded picture, rows from top to bottom without padding.
struct Frame
{
  int width = 0;                ///< [px]
  int height = 0;               ///< [px]
  int channels = 0;             ///< 1: grey, 3: blue, green, red; 8 bits each
  std::vector<uint8_t> pixels;  ///< width * height * channels bytes
  std::string error;            ///< not empty: the picture could not be decoded, for this reason; no pixels then
};

/// Decodes a grey picture file.
/// @param width, height the size the calibration holds for [px].
/// @return a frame with `error` set if the file cannot be read, is damaged or has another size. Never throws for bad
/// input.
Frame decodeGreyImage(const std::string& path, int width, int height);

/// Produces frames on a thread of its own, a bounded number ahead of the consumer, so that decoding does not move
/// the time line of playback. One consumer thread; stop() from any thread.
class FramePrefetcher
{
public:
  /// Returns the next frame, nullopt at the end. Called from the prefetch thread only.
  using Producer = std::function<std::optional<Frame>()>;

  /// Starts the thread. @param depth frames decoded ahead, at least 1.
  FramePrefetcher(Producer producer, size_t depth);
  ~FramePrefetcher();
  FramePrefetcher(const FramePrefetcher&) = delete;
  FramePrefetcher& operator=(const FramePrefetcher&) = delete;

  /// Waits for the next frame in order; nullopt at the end or after stop().
  std::optional<Frame> next();

  /// Ends next() and the thread; idempotent.
  void stop();

private:
  BoundedQueue<Frame> queue_;
  std::thread thread_;
};

}  // namespace pi_bringup
