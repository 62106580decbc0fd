#pragma once

#include <sys/types.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "event_loop/event_loop.h"

namespace pi_os_transport
{

/// Header of requests to the worker and of its answers; 24 bytes, little-endian, followed by `length` bytes of data.
/// The worker (pi_os_image_codec) uses the descriptor CODEC_SOCKET, answers one request after the other, and ends with
/// the connection.
struct CodecHeader
{
  enum Kind : uint32_t
  {
    ENCODE_JPEG = 1,   ///< parameter: quality, 1 .. 100; data: serialised sensor_msgs/Image
    ENCODE_PNG = 2,    ///< parameter: level, 1 .. 9; data: serialised sensor_msgs/Image
    DECODE = 3,        ///< data: serialised sensor_msgs/CompressedImage
    CONVERTED = 16,    ///< data: the serialised message
    UNSUPPORTED = 17,  ///< the image cannot be compressed this way; data: the reason as text
    BAD_DATA = 18,     ///< not such a message, or not decodable; data: the reason as text
  };
  static constexpr size_t BYTES = 24;

  uint32_t kind = 0;
  uint32_t parameter = 0;
  uint64_t id = 0;  ///< of the request; repeated in the answer
  uint64_t length = 0;

  std::array<uint8_t, BYTES> encode() const;
  static CodecHeader decode(const uint8_t* bytes);
};
constexpr int CODEC_SOCKET = 3;
constexpr uint64_t MAX_CODEC_TEXT = 1024;  ///< longest text of an answer [B]

/// Compresses and restores images in a separate process, so that hostile data cannot harm the bridge.
///
/// The first request starts the worker. A worker that dies, breaks the protocol or exceeds `timeout` is replaced; only
/// its current request fails. Not thread safe: everything runs on the event loop's thread.
class ImageCodec
{
public:
  struct Options
  {
    std::string program;                      ///< path of pi_os_image_codec
    uint64_t max_bytes = 256ULL << 20;        ///< largest message, in and out [B]
    size_t queue_limit = 8;                   ///< most requests at a time, including the current one
    std::chrono::milliseconds timeout{2000};  ///< for one request
    std::chrono::milliseconds pause{200};     ///< between the failure of a worker and the next start
  };

  enum class Compression
  {
    JPEG,
    PNG,
  };

  enum class Result
  {
    CONVERTED,
    UNSUPPORTED,  ///< send the image uncompressed
    BAD_DATA,
    FAILED,  ///< the worker died, hung or cannot be started
  };

  /// `message` is the serialised result for CONVERTED. Otherwise it is empty, and `detail` tells why in one line.
  using Callback = std::function<void(Result result, std::vector<uint8_t> message, const std::string& detail)>;

  ImageCodec(EventLoop* loop, Options options);
  /// Ends the worker. Pending callbacks are not called.
  ~ImageCodec();
  ImageCodec(const ImageCodec&) = delete;
  ImageCodec& operator=(const ImageCodec&) = delete;

  /// Converts a serialised sensor_msgs/Image to a sensor_msgs/CompressedImage, as image_transport's compressed plugin
  /// does. UNSUPPORTED: Bayer, YUV, float and signed pixels, 16 bit with JPEG, an alpha channel with PNG, foreign byte
  /// order. JPEG makes alpha opaque.
  /// @param quality  JPEG: 1 .. 100; PNG: level 1 .. 9.
  /// @param data     must stay valid until `done` has been called or destroyed; `done` may own it.
  /// @param done     called once, after this call has returned. It may call encode() and decode(), but must not destroy
  ///                 this object.
  /// @return false if the queue is full or `length` is above max_bytes; `done` is then not called.
  bool encode(Compression compression, int quality, const uint8_t* data, size_t length, Callback done);

  /// Converts a serialised CompressedImage back: same header, encoding and size; rows without padding, host byte order.
  /// A result above max_bytes is BAD_DATA. Otherwise like encode().
  bool decode(const uint8_t* data, size_t length, Callback done);

  size_t pending() const { return requests_.size(); }
  /// Process id of the worker; -1 if none runs.
  pid_t worker() const { return worker_; }

private:
  struct Request
  {
    CodecHeader header;
    const uint8_t* data;
    Callback done;
  };

  bool add(uint32_t kind, uint32_t parameter, const uint8_t* data, size_t length, Callback done);
  void wakeLater();
  void begin();
  bool startWorker(std::string* error);
  void endWorker();
  void onReady(uint32_t events);
  bool send();
  bool receive();
  bool finishAnswer();
  void complete(Result result, std::vector<uint8_t> message, const std::string& detail);
  void abandonWorker(const std::string& detail);

  EventLoop* const loop_;
  const Options options_;
  std::deque<Request> requests_;
  uint64_t next_id_ = 1;

  pid_t worker_ = -1;
  FileDescriptor socket_;
  bool working_ = false;  ///< the worker converts requests_.front()
  SteadyTime not_before_{};
  Timer wake_timer_;
  Timer deadline_timer_;

  std::array<uint8_t, CodecHeader::BYTES> request_header_{};
  size_t sent_ = 0;  ///< of header and data
  std::array<uint8_t, CodecHeader::BYTES> answer_header_{};
  CodecHeader answer_;
  std::vector<uint8_t> answer_data_;
  size_t received_ = 0;  ///< of header and data
};

}  // namespace pi_os_transport
