#pragma once

#include <pi_node/unique_fd.h>
#include <pi_os_transport/sp_stream.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

namespace pi_offload
{

/// One connection of nanomsg's request-reply protocol: messages begin with a stack of request numbers (32 bits, network
/// byte order). The wire below is pi_os_transport's.
///
/// receive() belongs to one thread. greet(), enqueue() and flush() need the owner's lock and may run beside receive().
class SpConnection : private pi_os_transport::SpReader::Sink
{
public:
  using Type = pi_os_transport::SpType;
  static constexpr uint32_t LAST_ID = 0x80000000U;  ///< marks the end of the stack of ids before a body

  /// @param fd  of a connected socket that does not block.
  SpConnection(pi_node::UniqueFd fd, Type own_type, Type peer_type, size_t max_message_bytes, size_t max_queued_bytes);
  SpConnection(const SpConnection&) = delete;
  SpConnection& operator=(const SpConnection&) = delete;

  int fd() const { return fd_.get(); }

  /// Takes a whole message. Returns false if the peer must be disconnected; `reason` tells why.
  using Taker = std::function<bool(std::vector<uint8_t> message, std::string* reason)>;
  /// Reads available bytes, up to a budget. @return false if the connection has ended; `reason` tells why.
  bool receive(const Taker& taker, std::string* reason);
  bool greeted() const { return reader_.greeted(); }  ///< the peer's header was received
  /// Memory of the message that is being received.
  size_t incomingBytes() const { return message_.capacity(); }

  /// Sends the own header; the first thing to do. @return false if the connection has ended; `reason` tells why.
  bool greet(std::string* reason);
  /// Queues a message: ids in network byte order, then the body. @return false if too much is queued.
  bool enqueue(const std::vector<uint32_t>& ids, const std::vector<uint8_t>& body);
  /// Hands queued bytes to the kernel. @return false if the connection has ended; `reason` tells why.
  bool flush(std::string* reason);
  bool wantsToWrite() const { return !outgoing_.empty(); }

private:
  bool onLength(uint64_t length) override;
  iovec place(size_t missing) override;
  bool onMessage() override;

  const pi_node::UniqueFd fd_;
  const Type own_type_;
  const Type peer_type_;
  const size_t max_message_bytes_;
  const size_t max_queued_bytes_;

  pi_os_transport::SpReader reader_;
  std::vector<uint8_t> message_;
  // While it receives:
  const Taker* taker_ = nullptr;
  std::string* reason_ = nullptr;

  pi_os_transport::SpWriter writer_;
  std::deque<std::vector<uint8_t>> outgoing_;  ///< the writer has the first one
  size_t waiting_bytes_ = 0;                   ///< of those behind it
};

/// Splits a message into the stack of ids before it and the body.
/// @return false unless there is a whole stack of at most `most` ids.
bool takeIds(std::vector<uint8_t>* message, size_t most, std::vector<uint32_t>* ids);

}  // namespace pi_offload
