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

/// A packet on the local socket that transfers shared memory. Descriptors are attached to it.
struct Packet
{
  enum Type : uint32_t
  {
    HELLO = 1,    ///< subscriber: values = link token, 1 for a bridge
    OFFER = 2,    ///< publisher: values = pool token, lease budget [B]; descriptors = ring memory, both doorbells
    PROOF = 3,    ///< subscriber: values = nonce read from the mapped ring
    SEGMENT = 4,  ///< publisher: values = segment id, length [B]; descriptors = segment memory
    RETIRED = 5,  ///< publisher: values = id of a segment that was freed
    ENDED = 6,    ///< either, between a node and a bridge: values = LinkEnd; nothing follows
    WAITING = 7,  ///< publisher to bridge: more messages wait for a place in the ring
    SPACE = 8,    ///< bridge to publisher: the ring has places again
    QUERY = 9,    ///< any process of this user: asks for the state
    STATE = 10,   ///< the answer: values = length [B]; descriptor = memory with JSON, see process_state.h
  };

  uint32_t version = PROTOCOL_VERSION;
  uint32_t type = 0;
  std::array<uint64_t, 3> values{};

  static Packet of(Type type, uint64_t first = 0, uint64_t second = 0, uint64_t third = 0)
  {
    return Packet{PROTOCOL_VERSION, type, {first, second, third}};
  }
  static Packet ended(LinkEnd reason) { return of(ENDED, static_cast<uint64_t>(reason)); }
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
    NOTHING,    ///< no packet waits
    CLOSED,     ///< the peer is gone, or has closed its end
    MALFORMED,  ///< not a packet of this version, or this process has no descriptors left
  };
  static constexpr size_t MAX_DESCRIPTORS = 3;
  using Descriptors = std::array<FileDescriptor, MAX_DESCRIPTORS>;
  Receive receive(Packet* packet, Descriptors* descriptors);
  /// @return false if the peer is gone or its queue is full
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
