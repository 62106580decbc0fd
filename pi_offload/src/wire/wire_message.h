#pragma once

#include "engine/node.h"

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_offload
{

/// What vehicles and nodes tell each other; bodies of SP request-reply messages (nanomsg's REQ and REP). All numbers
/// little endian, layout in docs/design/offload.md. Decoding checks every length and count against what is there.

/// A received message that is none of these, or is damaged. The text says what is wrong.
class WireError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

constexpr uint16_t WIRE_VERSION = 1;
constexpr size_t MAX_PAYLOAD = 32U << 20U;  ///< [bytes]

/// How a picture or sound is sent.
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
  uint64_t request = 0;  ///< unique for the vehicle; a CANCEL names the one to cancel
  std::string vehicle;   ///< 1 to 64 printable ASCII characters, no spaces
  TaskKind kind = TaskKind::DETECTION;
  int64_t sent_ns = 0;                             ///< by the vehicle's monotonic clock
  double remaining_s = 0.0;                        ///< until the answer is worth nothing any more, at sent_ns
  std::array<double, TASK_KINDS> lease_rate_hz{};  ///< wanted; 0: none
  Encoding encoding = Encoding::NONE;
  uint32_t width = 0;  ///< pictures [px]; of JPEG: not used
  uint32_t height = 0;
  double speech_s = 0.0;  ///< length of the speech in the sound of SPEECH; 0: not known, all of it
  std::string options;    ///< of the task: for SPEECH the commands, one per line; empty: the node's own
  std::vector<uint8_t> payload;
};

/// An object in a picture, as pi_detect::Detection.
struct DetectedObject
{
  int32_t class_id = -1;
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
    REFUSED = 1,  ///< not taken: `text` says why
    FAILED = 2,   ///< taken, but not done: `text` says why
    EXPIRED = 3,  ///< the time was over before a worker was free
  };
  Status status = Status::OK;
  OffloadRequest::Type type = OffloadRequest::Type::PROBE;  ///< that it answers
  uint64_t request = 0;
  TaskKind kind = TaskKind::DETECTION;
  double queue_s = 0.0;
  double service_s = 0.0;
  NodeAdvertisement advertisement;
  std::string text;                     ///< of a failure; of SPEECH: the command, empty if none was accepted
  std::vector<DetectedObject> objects;  ///< of DETECTION
  std::string model;                    ///< network that the node detects with; empty: it does not, or does not say
  float confidence = 0.0F;              ///< of SPEECH
  bool accepted = false;                ///< of SPEECH
};

/// Texts of replies are cut at 4096 bytes, names of models at 256.
/// @throws std::invalid_argument naming the field that could not be decoded again: numbers that are not finite, a
///   vehicle without a name, more than 64 KiB of options, MAX_PAYLOAD or 10000 objects.
std::vector<uint8_t> encode(const OffloadRequest& request);
std::vector<uint8_t> encode(const OffloadReply& reply);
/// @throws WireError naming what is wrong: too short, no message of this kind, another version, a length beyond the
/// end.
OffloadRequest decodeRequest(const uint8_t* data, size_t size);
OffloadReply decodeReply(const uint8_t* data, size_t size);

}  // namespace pi_offload
