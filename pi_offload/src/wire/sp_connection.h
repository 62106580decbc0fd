#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "wire/socket_tools.h"

namespace pi_offload
{

/// One connection of SP over TCP (nanomsg, rfc/sp-tcp-mapping-01.txt), from its first byte: each end sends its SP
/// header with the number of its socket type, then messages: the length as 64 bits in network byte order, and the
/// bytes.
///
/// receive() belongs to one thread; enqueue() and flush() to whoever holds the owner's lock; both at once are fine.
class SpConnection
{
public:
  static constexpr uint16_t REQ = 48;
  static constexpr uint16_t REP = 49;
  static constexpr uint32_t LAST_ID = 0x80000000U;  ///< marks the end of the stack of ids before a body

  /// @param fd  of a connected socket that does not block.
  SpConnection(UniqueFd fd, uint16_t own_type, uint16_t peer_type, size_t max_message_bytes, size_t max_queued_bytes);

  int fd() const { return fd_.get(); }

  /// Takes a whole message. @return false: it is not to be borne, `reason` says why.
  using Sink = std::function<bool(std::vector<uint8_t> message, std::string* reason)>;
  /// Reads what there is, up to some budget. @return false: the connection has ended, `reason` says why.
  bool receive(const Sink& sink, std::string* reason);
  bool greeted() const { return stage_ != Stage::GREETING; }  ///< the peer's header has come
  /// Memory that the message being received takes.
  size_t incomingBytes() const { return message_.capacity(); }

  /// Queues a message: ids in network byte order, then the body. @return false: too much is queued; nothing of it is
  /// then.
  bool enqueue(const std::vector<uint32_t>& ids, const std::vector<uint8_t>& body);
  /// Gives the kernel what it takes. @return false: the connection has ended, `reason` says why.
  bool flush(std::string* reason);
  bool wantsToWrite() const { return !outgoing_.empty(); }

private:
  static constexpr size_t GREETING_BYTES = 8;
  static constexpr size_t LENGTH_BYTES = 8;
  enum class Stage
  {
    GREETING,
    LENGTH,
    MESSAGE,
  };
  bool takeBytes(const uint8_t* bytes, size_t count, const Sink& sink, std::string* reason);
  bool onHead(const Sink& sink, std::string* reason);
  bool onMessageBytes(size_t count, const Sink& sink, std::string* reason);
  void makeRoom();

  UniqueFd fd_;
  const uint16_t peer_type_;
  const size_t max_message_bytes_;
  const size_t max_queued_bytes_;

  Stage stage_ = Stage::GREETING;
  std::array<uint8_t, 8> head_{};
  size_t head_bytes_ = 0;
  size_t length_ = 0;    ///< of the message
  size_t received_ = 0;  ///< of it
  std::vector<uint8_t> message_;

  std::deque<std::vector<uint8_t>> outgoing_;
  size_t sent_ = 0;          ///< of the first one
  size_t queued_bytes_ = 0;  ///< of all, without what was sent
};

/// Splits a message into the stack of ids before it and the body.
/// @return false if there is no whole stack of at most `most` ids.
bool takeIds(std::vector<uint8_t>* message, size_t most, std::vector<uint32_t>* ids);

}  // namespace pi_offload
