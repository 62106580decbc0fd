#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "wire/payload.h"

namespace pi_os_transport
{

/// Version of everything two bridges say to each other.
constexpr uint8_t WIRE_VERSION = 1;
/// Largest payload of one frame [B]. A frame that announces more is refused before anything is read of it.
constexpr uint32_t MAX_PAYLOAD = 256 * 1024;

/// What one frame between two bridges means (docs/design/device_bridge.md). `id`, `count` and `offset` are those of the
/// header; "payload" lists what follows it.
enum class FrameType : uint8_t
{
  HELLO = 1,           ///< id: traffic class of this connection; payload: Hello
  PING = 2,            ///< nothing but a sign of life
  ACK = 3,             ///< id: traffic class; offset: frames received on it so far
  LINK_OPEN = 4,       ///< subscriber's side. id: link; payload: LinkOpen
  LINK_READY = 5,      ///< publisher's side: the publisher's memory is mapped. id: link
  LINK_PROVED = 6,     ///< subscriber's side: the subscriber reads shared memory. id: link
  LINK_START = 7,      ///< publisher's side, before the first message. id: link; count: messages that went over TCPROS
                       ///< before; offset: queue size of the publisher
  LINK_CLOSE = 8,      ///< either side. id: link; count: LinkEnd; payload: reason as text
  LINK_PAUSE = 9,      ///< subscriber's side: the subscriber takes no more. id: link
  LINK_RESUME = 10,    ///< id: link
  MESSAGE = 11,        ///< whole small message. id: stream; count: number of entries; payload: entries, message
  BEGIN = 12,          ///< large message follows. id: stream; count: number of entries; offset: message bytes;
                       ///< payload: entries
  FRAGMENT = 13,       ///< id: stream; offset: of these bytes in the message; payload: bytes
  ATTACH = 14,         ///< the message begun last on this stream is also for these. id: stream; payload: entries
  TUNNEL_OPEN = 15,    ///< client's side. id: tunnel; count: TCP port; payload: host
  TUNNEL_READY = 16,   ///< server's side: connected. id: tunnel
  TUNNEL_DATA = 17,    ///< either side. id: tunnel; offset: of these bytes in this direction; payload: bytes
  TUNNEL_CREDIT = 18,  ///< id: tunnel; offset: bytes of the other direction handed on so far
  TUNNEL_CLOSE = 19,   ///< id: tunnel; offset: bytes of this direction in all; count: 1 if the peer must not wait for
                       ///< them; payload: reason as text
};
constexpr uint8_t LAST_FRAME_TYPE = 19;

/// Start of every frame; 32 bytes on the wire, little-endian.
struct FrameHeader
{
  static constexpr size_t BYTES = 32;
  static constexpr uint16_t MAGIC = 0x506f;  // "oP"

  uint8_t version = WIRE_VERSION;
  FrameType type = FrameType::PING;
  uint32_t id = 0;
  uint64_t session = 0;  ///< what the receiver told this sender in its HELLO; 0 in a first HELLO
  uint32_t count = 0;
  uint32_t lane = 0;  ///< traffic class of the connection, and ACK_NOW; HELLO, PING and ACK are not counted there
  uint64_t offset = 0;

  std::array<uint8_t, BYTES> encode() const;
  /// False if the bytes are no header of ours; a header of another version is decoded as far as `version`.
  static bool decode(const uint8_t* bytes, FrameHeader* header);
};

/// Flag in `lane`: the sender waits for the acknowledgement of this frame.
constexpr uint32_t ACK_NOW = 1u << 31;

/// `count` of a LINK_CLOSE from the subscriber's side; both sides number their links.
constexpr uint32_t FROM_SUBSCRIBER = 1u << 31;

/// Flag in `count` of MESSAGE and BEGIN: the bytes are a sensor_msgs/CompressedImage that stands for a
/// sensor_msgs/Image.
constexpr uint32_t COMPRESSED = 1u << 31;

/// One link that a message is for; 12 bytes on the wire.
struct LinkEntry
{
  static constexpr size_t BYTES = 12;
  uint32_t link = 0;
  uint32_t sequence = 0;   ///< of this message on the link, from 1, modulo 2^32
  uint32_t after_tcp = 0;  ///< as in Descriptor

  void append(PayloadWriter* out) const;
  static LinkEntry read(PayloadReader* in);
};

/// First frame of every connection, and again when something of it has changed.
struct Hello
{
  uint64_t instance = 0;  ///< random per process: another one means that the peer was restarted
  uint64_t secret = 0;    ///< the receiver puts this into `session` of its frames to the sender
  uint64_t echo = 0;      ///< `secret` of the receiver as far as known, else 0: shows that the sender is where it says
  uint16_t port = 0;      ///< where the sender listens
  std::string address;    ///< and under which address
  bool fixed = false;     ///< the address was configured: it holds, whatever the connection seems to come from
  uint32_t max_message_bytes = 0;  ///< larger ones are refused; they have to stay on TCPROS [B]
  std::string name;                ///< of the device, for people

  std::vector<uint8_t> encode() const;
  static bool decode(const uint8_t* payload, size_t length, Hello* hello);
};

/// Asks the publisher's bridge to fetch a link.
struct LinkOpen
{
  std::string socket_token;  ///< of the publisher's process
  std::string link_token;
  std::string topic;
  std::string type;        ///< message type
  std::string publisher;   ///< node name
  std::string subscriber;  ///< node name

  std::vector<uint8_t> encode() const;
  static bool decode(const uint8_t* payload, size_t length, LinkOpen* open);
};

}  // namespace pi_os_transport
