#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/node.h"

namespace pi_offload
{

// Bodies of the request-reply messages between vehicles and nodes. Numbers are little endian; docs/design/offload.md
// shows the layout. Decoding checks every length and count.

/// A received message of another kind or with damage; the text tells which.
class WireError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

constexpr uint16_t WIRE_VERSION = 2;        ///< 2: objects carry the name of their class
constexpr size_t MAX_PAYLOAD = 32U << 20U;  ///< [bytes]

/// Format of a picture or sound.
enum class Encoding : uint8_t
{
  NONE = 0,
  BGR8 = 1,
  RGB8 = 2,
  MONO8 = 3,
  JPEG = 4,
  S16LE = 5,  ///< sound, 16 kHz, one channel
};

struct OffloadRequest
{
  enum class Type : uint8_t
  {
    PROBE = 1,
    TASK = 2,
    CANCEL = 3,
  };
  Type type = Type::PROBE;
  uint64_t request = 0;  ///< unique for the vehicle; CANCEL: the request to cancel
  std::string vehicle;   ///< 1 to 64 printable ASCII characters, no spaces
  TaskKind kind = TaskKind::DETECTION;
  int64_t sent_ns = 0;                             ///< by the vehicle's monotonic clock
  double remaining_s = 0.0;                        ///< from sent_ns until the answer is useless
  std::array<double, TASK_KINDS> lease_rate_hz{};  ///< wanted; 0: none
  Encoding encoding = Encoding::NONE;
  uint32_t width = 0;  ///< of a picture [px]; not used for JPEG
  uint32_t height = 0;
  double speech_s = 0.0;  ///< length of the speech in the sound; 0: all of it
  std::string options;    ///< of SPEECH: the commands, one per line; empty: the node's own
  std::vector<uint8_t> payload;
};

/// An object in a picture, as pi_detect::Detection. Its class has a name: numbers differ from network to network.
struct DetectedObject
{
  std::string label;
  float score = 0.0F;
  float x1 = 0.0F;
  float y1 = 0.0F;
  float x2 = 0.0F;
  float y2 = 0.0F;
};

struct OffloadReply
{
  enum class Status : uint8_t
  {
    OK = 0,
    REFUSED = 1,  ///< not taken; `text` tells why
    FAILED = 2,   ///< taken but not done; `text` tells why
    EXPIRED = 3,  ///< no worker was free in time
  };
  Status status = Status::OK;
  OffloadRequest::Type type = OffloadRequest::Type::PROBE;  ///< of the request
  uint64_t request = 0;
  TaskKind kind = TaskKind::DETECTION;
  double queue_s = 0.0;
  double service_s = 0.0;
  NodeAdvertisement advertisement;
  std::string text;                     ///< reason of a failure; SPEECH: the command, empty if none was accepted
  std::vector<DetectedObject> objects;  ///< of DETECTION
  std::string model;                    ///< network of the node's detector; empty: none or not told
  float confidence = 0.0F;              ///< of SPEECH
  bool accepted = false;                ///< of SPEECH
};

/// Cuts texts of replies at 4096 bytes and names of models at 256.
/// @throws std::invalid_argument naming a field that cannot be decoded again: numbers that are not finite, a vehicle
///   without a name, more than 64 KiB of options, MAX_PAYLOAD, 10000 objects, 1024 labels or 256 bytes of a label.
std::vector<uint8_t> encode(const OffloadRequest& request);
std::vector<uint8_t> encode(const OffloadReply& reply);
/// Of an encoded request.
inline TaskKind kindOf(const std::vector<uint8_t>& request)
{
  return static_cast<TaskKind>(request.at(7));
}
/// @throws WireError for a short message, another kind or version, or a length beyond the end.
OffloadRequest decodeRequest(const uint8_t* data, size_t size);
OffloadReply decodeReply(const uint8_t* data, size_t size);

}  // namespace pi_offload
