#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Version of the packets, the ring and the descriptor layout. Peers with another version use TCPROS.
constexpr uint32_t PROTOCOL_VERSION = 4;

/// 128 random bits. Names sockets, links and pools: unique, and impossible to guess.
struct Token
{
  uint64_t high = 0;
  uint64_t low = 0;

  static Token random();
  /// 32 hexadecimal digits.
  std::string toString() const;
  static std::optional<Token> fromString(const std::string& text);
  bool operator==(const Token& other) const { return high == other.high && low == other.low; }
  bool operator<(const Token& other) const { return high != other.high ? high < other.high : low < other.low; }
};

/// Why a link through bridges ended.
enum class LinkEnd : uint32_t
{
  CLOSED = 0,             ///< the publisher's process has closed the link, or has ended
  REFUSED = 1,            ///< the link cannot or must not be carried
  PUBLISHER_UNAWARE = 2,  ///< the path is broken, and the publisher may not have noticed
  BACK_TO_TCP = 3,        ///< the path is broken, or one side left; both sides know
};

/// A packet on the local socket that two processes share. Descriptors are attached to it.
struct Packet
{
  enum Type : uint32_t
  {
    HELLO = 1,      ///< receiver: values = link token, topicMark() from a bridge and else 0
    OFFER = 2,      ///< sender: values = lease budget [B]; descriptor = ring memory
    PROOF = 3,      ///< receiver: values = nonce read from the mapped ring
    SEGMENT = 4,    ///< sender, for all its links: values = segment id, length [B]; descriptor = segment memory
    RETIRED = 5,    ///< sender, for all its links: values = id of a segment that was freed
    ENDED = 6,      ///< either: values = LinkEnd; nothing follows about this link
    WAITING = 7,    ///< sender to bridge: more messages wait for a place in the ring
    SPACE = 8,      ///< bridge to sender: the ring has places again
    QUERY = 9,      ///< any process of this user, as the first packet: asks for the state
    STATE = 10,     ///< the answer: values = length [B]; descriptor = memory with JSON, see process_state.h
    MEET = 11,      ///< first packet of either side: values = own socket token; descriptors = NewsLayout, WakeLayout
    BELL = 12,      ///< sender: the NewsLayout has news
    DECLINED = 13,  ///< receiver: takes nothing more from the ring, but may still read what it has taken
  };
  /// Bit of `link`: the packet goes to the end that sends messages. The other bits are the number that the receiver of
  /// messages chose; modulo NewsLayout::LINKS it is the link's place there.
  static constexpr uint32_t TO_SENDER = uint32_t{1} << 31;

  uint32_t version = PROTOCOL_VERSION;
  uint32_t type = 0;
  uint32_t link = 0;
  uint32_t unused = 0;
  std::array<uint64_t, 3> values{};

  static Packet of(Type type, uint32_t link, uint64_t first = 0, uint64_t second = 0, uint64_t third = 0)
  {
    return Packet{PROTOCOL_VERSION, type, link, 0, {first, second, third}};
  }
  static Packet ended(uint32_t link, LinkEnd reason) { return of(ENDED, link, static_cast<uint64_t>(reason)); }
};

/// A non-blocking sequenced-packet socket in the abstract namespace. It reaches processes in the same network
/// namespace, leaves no file behind, and reports the peer's death at once. One sender and one receiver may use it at a
/// time.
class SideChannel
{
public:
  SideChannel() = default;
  explicit SideChannel(FileDescriptor socket) : socket_(std::move(socket)) {}

  /// Listens under `name`. Empty on failure, with errno set.
  static SideChannel listen(const std::string& name);
  /// Empty on failure, with errno set: ECONNREFUSED if no process in this network namespace listens there, EPERM if the
  /// listener belongs to another user.
  static SideChannel connect(const std::string& name);
  /// Accepts a waiting connection of the same user and closes those of other users. Empty if none is left.
  SideChannel accept();

  enum class Receive
  {
    PACKET,
    NOTHING,         ///< no packet waits
    CLOSED,          ///< the peer is gone, or has closed its end
    MALFORMED,       ///< not a packet of this version
    NO_DESCRIPTORS,  ///< a packet whose descriptors this process has no room for
  };
  static constexpr size_t MAX_DESCRIPTORS = 3;
  using Descriptors = std::array<FileDescriptor, MAX_DESCRIPTORS>;
  Receive receive(Packet* packet, Descriptors* descriptors);
  /// @return false if the peer is gone or its queue is full (errno EAGAIN)
  bool send(const Packet& packet, std::initializer_list<int> descriptors = {});
  /// Sends a packet of any form.
  bool sendBytes(const void* bytes, size_t length, std::initializer_list<int> descriptors = {});
  /// Receives a packet of any form. @param bytes  resized to the packet. @param longest  longer packets are MALFORMED.
  Receive receiveBytes(std::vector<uint8_t>* bytes, size_t longest, Descriptors* descriptors);

  int fd() const { return socket_.get(); }
  explicit operator bool() const { return static_cast<bool>(socket_); }
  void close() { socket_.reset(); }

private:
  Receive receiveInto(void* bytes, size_t* length, Descriptors* descriptors);

  FileDescriptor socket_;
};

}  // namespace pi_os_transport
