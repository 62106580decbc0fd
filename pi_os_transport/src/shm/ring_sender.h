#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "shm/descriptor_ring.h"
#include "shm/process_pair.h"
#include "shm/shared_memory.h"
#include "shm/slot_pool.h"

namespace pi_os_transport
{

/// Size of the length at the start of a message's buffer, as in TCPROS [B].
constexpr uint32_t LENGTH_PREFIX = 4;

/// What TCPROS holds in its socket buffers beside its queue [B]. Nodes that publish with a queue of one rely on this.
constexpr uint64_t SOCKET_BYTES = 1 << 20;

/// The sending end of one link in shared memory: the ring, and the subscriber's references in the pool. The caller
/// serialises all calls.
class RingSender
{
public:
  /// @param pool  must outlive this object.
  /// @param lease_budget  most shared memory that the subscriber may pin [B].
  RingSender(SlotPool* pool, uint64_t lease_budget) : pool_(pool), lease_budget_(lease_budget) {}
  ~RingSender() { close(); }
  RingSender(const RingSender&) = delete;
  RingSender& operator=(const RingSender&) = delete;

  /// Makes the ring and offers it to the subscriber.
  /// @param link  the number that the subscriber gave the link.
  /// @return false with `*error` set, which is empty if the subscriber has left; this object is then unchanged.
  bool open(std::shared_ptr<ProcessPair> pair, uint32_t link, std::string* error);
  bool isOpen() const { return pair_ != nullptr; }
  /// Ends the link and frees all memory that the subscriber held.
  void close();

  /// Only while open.
  ProcessPair& pair() { return *pair_; }
  uint32_t link() const { return link_; }
  /// Sends a packet about this link. @return false if the subscriber has left.
  bool tell(Packet::Type type, uint64_t value = 0) { return pair_ && pair_->send(Packet::of(type, link_, value)); }
  /// True if `packet` proves that the subscriber has mapped the ring.
  bool isProof(const Packet& packet) const { return packet.type == Packet::PROOF && packet.values[0] == nonce_; }

  enum class Push
  {
    WRITTEN,  ///< the ring took over one reference of the buffer
    FULL,     ///< no place, or the subscriber pins too much memory
    BROKEN,   ///< the subscriber wrote invalid indices
  };
  /// @param buffer  memory of the pool: LENGTH_PREFIX bytes, then `length` bytes of message.
  /// @param max_queue  most waiting messages (plus one, see .cpp) before the oldest is dropped; 0: no limit.
  Push push(const uint8_t* buffer, uint32_t length, size_t max_queue, uint32_t after_tcp, uint64_t serial);
  /// Writes the descriptor that starts a link through bridges. False if there is no place.
  bool pushStart(size_t max_queue, bool latched, uint32_t after_tcp);

  /// Frees what the subscriber has released.
  void collect();

  struct Message
  {
    const uint8_t* buffer;  ///< with one reference, owned by the caller
    uint32_t length;        ///< [B], without the prefix
    uint32_t after_tcp;     ///< as in Descriptor
  };
  /// Takes back all messages that the subscriber has not taken, oldest first.
  std::vector<Message> takeBack();
  /// After takeBack(): takes back all messages that the subscriber has taken but not released, oldest first.
  std::vector<Message> takeBackTaken();

  /// Messages written that the subscriber has not taken.
  uint32_t untaken() const { return ring_ ? ring_->inFlight() : 0; }
  /// Bytes of these messages.
  uint64_t untakenBytes() const;
  /// True if the subscriber holds nothing: waiting frees no place.
  bool idle() const { return !ring_ || ring_->idle(); }
  uint64_t sent() const { return sent_; }
  uint64_t dropped() const { return dropped_; }

private:
  bool write(const Descriptor& descriptor, const uint8_t* buffer);
  void give(uint32_t ticket);

  SlotPool* const pool_;
  const uint64_t lease_budget_;
  std::shared_ptr<ProcessPair> pair_;
  uint32_t link_ = 0;
  SharedMapping memory_;  ///< of the ring
  std::unique_ptr<RingProducer> ring_;
  uint64_t nonce_ = 0;
  std::vector<Message> messages_;  ///< by ticket; the buffer is null if there is none
  uint32_t tail_ = 0;                    ///< index of the next message in the ring
  uint64_t sent_ = 0;
  uint64_t dropped_ = 0;
};

}  // namespace pi_os_transport
