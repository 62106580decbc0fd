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

/// Version of everything two processes share: packets, ring and descriptor layout. Peers with another version use
/// TCPROS.
constexpr uint32_t PROTOCOL_VERSION = 3;

/// 128 random bits: names sockets, links and pools so that they can neither clash nor be guessed.
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
  REFUSED = 1,            ///< it cannot or may not be carried
  PUBLISHER_UNAWARE = 2,  ///< the path is broken, and the publisher may not have noticed
  BACK_TO_TCP = 3,        ///< the path is broken, or one side does not want it any more; both know
};

/// One packet on the local socket that hands over shared memory. Descriptors travel beside it.
struct Packet
{
  enum Type : uint32_t
  {
    HELLO = 1,    ///< subscriber: values = link token, 1 if it is a bridge that asks for a subscriber elsewhere
    OFFER = 2,    ///< publisher: values = pool token, lease budget [B]; descriptors = ring memory, both doorbells
    PROOF = 3,    ///< subscriber: values = nonce read from the mapped ring
    SEGMENT = 4,  ///< publisher: values = segment id, length [B]; descriptors = segment memory
    RETIRED = 5,  ///< publisher: values = segment id that is not used any more
    ENDED = 6,    ///< either, between a node and a bridge: values = LinkEnd; nothing follows
    WAITING = 7,  ///< publisher to bridge: more messages wait for a place in the ring
    SPACE = 8,    ///< bridge to publisher: there is place again
    QUERY = 9,    ///< anybody of this user: asks a process for its state
    STATE = 10,   ///< the answer: values = length [B]; descriptor = memory with JSON, see process_state.h
  };

  uint32_t version = PROTOCOL_VERSION;
  uint32_t type = 0;
  std::array<uint64_t, 3> values{};
};

/// A non-blocking sequenced-packet socket in the abstract namespace: it reaches processes in the same network namespace
/// only, leaves nothing behind, and reports the death of the peer at once. Thread safety: one sender and one receiver.
class SideChannel
{
public:
  SideChannel() = default;
  explicit SideChannel(FileDescriptor socket) : socket_(std::move(socket)) {}

  /// Listens under `name`. Empty on failure, with errno set.
  static SideChannel listen(const std::string& name);
  /// Empty on failure, with errno set: ECONNREFUSED if nobody in this network namespace listens there, EPERM if a
  /// process of another user does.
  static SideChannel connect(const std::string& name);
  /// Accepts one waiting connection of the same user; those of other users are closed. Empty if none is left.
  SideChannel accept();

  enum class Receive
  {
    PACKET,
    NOTHING,    ///< none waits
    CLOSED,     ///< the peer is gone, or has closed its end
    MALFORMED,  ///< no packet of this version, or one whose descriptors did not fit into this process's table
  };
  static constexpr size_t MAX_DESCRIPTORS = 3;
  Receive receive(Packet* packet, std::array<FileDescriptor, MAX_DESCRIPTORS>* descriptors);
  /// False if the peer is gone or its queue is full.
  bool send(const Packet& packet, std::initializer_list<int> descriptors = {});
  /// One packet of any other form. Same result.
  bool sendBytes(const void* bytes, size_t length, std::initializer_list<int> descriptors = {});
  /// Receives one packet of any form. @param bytes resized to what came; longer packets are MALFORMED.
  Receive receiveBytes(std::vector<uint8_t>* bytes, size_t longest,
                       std::array<FileDescriptor, MAX_DESCRIPTORS>* descriptors);

  int fd() const { return socket_.get(); }
  explicit operator bool() const { return static_cast<bool>(socket_); }
  void close() { socket_.reset(); }

private:
  Receive receiveInto(void* bytes, size_t* length, std::array<FileDescriptor, MAX_DESCRIPTORS>* descriptors);

  FileDescriptor socket_;
};

}  // namespace pi_os_transport
