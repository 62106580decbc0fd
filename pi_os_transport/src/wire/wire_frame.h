#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "wire/payload.h"

namespace pi_os_transport
{

/// Version of the protocol between bridges.
constexpr uint8_t WIRE_VERSION = 1;
/// Largest payload of one frame [B]. A frame that announces more is refused unread.
constexpr uint32_t MAX_PAYLOAD = 256 * 1024;

/// Type of a frame between bridges (docs/design/device_bridge.md). `id`, `count` and `offset` are fields of the header;
/// "payload" lists what follows the header.
enum class FrameType : uint8_t
{
  HELLO = 1,           ///< id: traffic class of this connection; payload: Hello
  PING = 2,            ///< a sign of life
  ACK = 3,             ///< id: traffic class; offset: frames received on this connection so far
  LINK_OPEN = 4,       ///< subscriber's side. id: link; payload: LinkOpen
  LINK_READY = 5,      ///< publisher's side: the publisher's memory is mapped. id: link
  LINK_PROVED = 6,     ///< subscriber's side: the subscriber reads shared memory. id: link
  LINK_START = 7,      ///< publisher's side, before the first message. id: link; count: messages that went over TCPROS
                       ///< before; offset: queue size of the publisher
  LINK_CLOSE = 8,      ///< either side. id: link; count: LinkEnd; payload: reason as text
  LINK_PAUSE = 9,      ///< subscriber's side: the subscriber accepts no more. id: link
  LINK_RESUME = 10,    ///< id: link
  MESSAGE = 11,        ///< a small message. id: stream; count: number of entries; payload: entries, message
  BEGIN = 12,          ///< a large message follows. id: stream; count: number of entries; offset: message bytes;
                       ///< payload: entries
  FRAGMENT = 13,       ///< id: stream; offset: position in the message; payload: bytes
  ATTACH = 14,         ///< the last message of this stream is also for these links. id: stream; payload: entries
  TUNNEL_OPEN = 15,    ///< client's side. id: tunnel; count: TCP port; payload: host, name of the service
  TUNNEL_READY = 16,   ///< server's side: connected. id: tunnel
  TUNNEL_DATA = 17,    ///< either side. id: tunnel; offset: position in this direction; payload: bytes
  TUNNEL_CREDIT = 18,  ///< id: tunnel; offset: bytes of the other direction delivered so far
  TUNNEL_CLOSE = 19,   ///< id: tunnel; offset: total bytes of this direction; count: 1 if the peer must not wait for
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
  uint64_t session = 0;  ///< `secret` from the receiver's HELLO; 0 in a first HELLO
  uint32_t count = 0;
  uint32_t lane = 0;  ///< traffic class of the connection, and ACK_NOW; HELLO, PING and ACK are not counted
  uint64_t offset = 0;

  static FrameHeader of(FrameType type, uint32_t id = 0, uint32_t count = 0, uint64_t offset = 0);
  std::array<uint8_t, BYTES> encode() const;
  /// False if the bytes are not a header of this protocol. Of another version only `version` is decoded.
  static bool decode(const uint8_t* bytes, FrameHeader* header);
};

/// The payload of a frame that carries one text.
std::vector<uint8_t> encodeText(const std::string& text);

/// Flag in `lane`: the sender waits for an acknowledgement of this frame.
constexpr uint32_t ACK_NOW = 1u << 31;

/// `count` of a LINK_CLOSE from the subscriber's side. Needed because both sides number their links.
constexpr uint32_t FROM_SUBSCRIBER = 1u << 31;

/// Flag in `count` of MESSAGE and BEGIN: a sensor_msgs/CompressedImage replaces a sensor_msgs/Image.
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

/// First frame of every connection; sent again when a field changes.
struct Hello
{
  uint64_t instance = 0;           ///< random number of the process: changes when the peer restarts
  uint64_t secret = 0;             ///< the receiver writes this to `session` of its frames to the sender
  uint64_t echo = 0;               ///< `secret` of the receiver if known, else 0: proves the sender's address
  uint16_t port = 0;               ///< TCP port of the sender
  std::string address;             ///< where the sender listens
  bool fixed = false;              ///< the address was configured: use it instead of the connection's source
  uint32_t max_message_bytes = 0;  ///< larger messages are refused and have to stay on TCPROS [B]
  std::string name;                ///< of the device, for display

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
