#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>

#include "shm/descriptor_ring.h"
#include "shm/process_pair.h"
#include "shm/shared_memory.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// The receiving end of one link in shared memory: its number and its ring.
///
/// The caller serialises all calls except release(), disturb() and sleep(). The publisher keeps a taken message until
/// it is released or this object ends, so this object must live while such a message is read.
class RingReceiver
{
public:
  /// @param link  gets the packets of the link, and serve() for its messages.
  RingReceiver(std::shared_ptr<ProcessPair> pair, const std::shared_ptr<PairLink>& link)
    : pair_(std::move(pair)), number_(pair_->addReceiver(link))
  {
  }
  ~RingReceiver() { leave(); }
  RingReceiver(const RingReceiver&) = delete;
  RingReceiver& operator=(const RingReceiver&) = delete;

  /// The number of the link; 0: the pair has no place for it, or has ended.
  uint32_t number() const { return number_; }
  ProcessPair& pair() { return *pair_; }
  /// The link is not called any more.
  void detach() { pair_->removeReceiver(number_); }
  /// Tells the publisher that nothing more is read. Done by the destructor if not before.
  void leave();

  /// Asks for the ring. @param token  of the link. @param mark  topicMark() from a bridge, else 0.
  bool sendHello(const Token& token, uint64_t mark = 0);
  /// Maps the ring. @return false if it cannot be used: decline(); errno tells of a shortage.
  bool onOffer(const Packet& offer, SideChannel::Descriptors* descriptors);
  bool hasRing() const { return ring_ != nullptr; }
  /// Tells the publisher that the ring is mapped. The publisher writes no message before this.
  bool sendProof();
  /// Tells the publisher that nothing more is taken: what waits in the ring goes over TCPROS.
  void decline();
  /// Sends a packet about this link.
  void tell(Packet::Type type) { pair_->send(Packet::of(type, number_ | Packet::TO_SENDER)); }

  /// Only with a ring.
  RingConsumer& ring() { return *ring_; }

  enum class Take
  {
    TAKEN,
    WAITING,     ///< for a message over TCPROS, or for memory: the link is served when it comes
    EMPTY,       ///< the doorbell is armed
    UNREADABLE,  ///< this process cannot get the memory of the next message: decline()
  };
  struct Message
  {
    Descriptor descriptor;
    uint32_t ticket = 0;
    std::shared_ptr<MappedSegment> segment;  ///< where it lies; null: the descriptor is invalid, or starts the link
  };
  /// Like RingConsumer::take(), but takes no message whose memory has not come, unless the pair has ended.
  Take take(uint32_t tcp_delivered, bool in_any_order, Message* message);
  /// Finds the memory of a message. @return TAKEN, with `*segment` as in Message; WAITING; or UNREADABLE
  Take find(const Descriptor& descriptor, std::shared_ptr<MappedSegment>* segment);
  /// Sleeps until the publisher writes after take() has found the ring EMPTY, or until disturb(). For WAITING_THREAD.
  void sleep();
  void disturb();

  /// Most shared memory that may be leased at a time [B].
  uint64_t leaseBudget() const { return lease_budget_; }
  /// Counts a message that is read in place, until endLease(). Any thread.
  void lease(uint32_t length);
  void endLease(uint32_t ticket, uint32_t length);
  uint64_t leasedBytes() const { return leased_bytes_.load(std::memory_order_relaxed); }
  uint32_t leases() const { return leases_.load(std::memory_order_relaxed); }
  /// Returns a message to the publisher. Any thread.
  void release(uint32_t ticket) { ring_->release(ticket); }

private:
  RingLayout* layout() const { return reinterpret_cast<RingLayout*>(memory_.data()); }

  const std::shared_ptr<ProcessPair> pair_;
  const uint32_t number_;
  bool left_ = false;
  SharedMapping memory_;  ///< of the ring
  std::unique_ptr<RingConsumer> ring_;
  uint64_t nonce_ = 0;
  uint64_t lease_budget_ = 0;
  std::atomic<uint64_t> leased_bytes_{0};
  std::atomic<uint32_t> leases_{0};
};

}  // namespace pi_os_transport
