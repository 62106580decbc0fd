#pragma once

#include "protocol/messages.h"

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace pi_web
{

/// The parts of a serialised sensor_msgs/Image that points into it.
struct PictureView
{
  uint32_t seq = 0;
  uint32_t stamp_sec = 0;
  uint32_t stamp_nsec = 0;
  std::string_view frame_id;
  uint32_t height = 0;
  uint32_t width = 0;
  std::string_view encoding;
  uint32_t step = 0;
  const uint8_t* pixels = nullptr;

  /// @throws std::invalid_argument if these bytes are no picture.
  explicit PictureView(const Bytes& message);
};

/// Serialised sensor_msgs/Image to serialised sensor_msgs/CompressedImage. Not thread safe.
class JpegEncoder
{
public:
  /// @param max_width  wider pictures are made smaller by a whole factor [px].
  /// @param quality    1 to 100.
  JpegEncoder(int max_width, int quality);
  ~JpegEncoder();
  JpegEncoder(const JpegEncoder&) = delete;
  JpegEncoder& operator=(const JpegEncoder&) = delete;

  /// The frame_id stays; format tells the size of the original: "jpeg 1280x960".
  /// @throws std::invalid_argument for encodings other than mono8, mono16, bgr8, rgb8, bgra8, rgba8 and 8UC1.
  Payload encode(const Bytes& image);

private:
  const int max_width_;
  const int quality_;
  void* compressor_;
  unsigned char* buffer_ = nullptr;
  unsigned long capacity_ = 0;
  std::vector<uint8_t> small_;
};

}  // namespace pi_web
