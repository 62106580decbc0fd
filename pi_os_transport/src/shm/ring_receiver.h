#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "shm/descriptor_ring.h"
#include "shm/ring_sender.h"
#include "shm/shared_memory.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// A segment of a publisher's pool, mapped read-only. Shared by all links of this process to that publisher.
class MappedSegment
{
public:
  /// Maps `memory`. If there is no address space, copy() reads through the descriptor.
  MappedSegment(FileDescriptor memory, uint64_t length);

  uint64_t length() const { return length_; }
  /// Null if it could not be mapped.
  const uint8_t* data() const { return mapping_.data(); }
  /// Copies [offset, offset + bytes) out. False on a read error.
  bool copy(uint64_t offset, uint8_t* out, uint32_t bytes) const;

private:
  SharedMapping mapping_;
  FileDescriptor memory_;  ///< only if it could not be mapped
  uint64_t length_;
};

/// The receiving end of one link in shared memory: side channel, ring, doorbells and mapped segments.
///
/// The caller serialises all calls except release(). The publisher keeps a taken message until it is released or the
/// side channel closes, so this object must live while such a message is read.
class RingReceiver
{
public:
  explicit RingReceiver(SideChannel channel) : channel_(std::move(channel)) {}

  int fd() const { return channel_.fd(); }
  SideChannel& channel() { return channel_; }

  /// Reads all waiting packets. The first OFFER creates the ring, see hasRing().
  /// @return NOTHING if more may come, else why not.
  SideChannel::Receive readPackets();
  bool hasRing() const { return ring_ != nullptr; }
  /// Tells the publisher that the ring is mapped. The publisher writes no message before this.
  bool sendProof();
  /// The reason in ENDED, if it was received.
  const std::optional<LinkEnd>& ended() const { return ended_; }

  /// True once after the publisher reported that messages wait for places in the ring.
  bool takePublisherWaits() { return std::exchange(publisher_waits_, false); }

  /// Only with a ring.
  RingConsumer& ring() { return *ring_; }
  /// Descriptor to wait for; -1 once closed.
  int doorbell(Doorbell number) const { return doorbells_[number - 1].get(); }
  void closeDoorbells() { doorbells_ = {}; }

  /// Finds the segment of a taken message, and reads packets if necessary. @return null if the descriptor is invalid.
  std::shared_ptr<MappedSegment> find(const Descriptor& descriptor);

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
  void onOffer(const Packet& packet, SideChannel::Descriptors descriptors);

  SideChannel channel_;
  std::array<FileDescriptor, DOORBELLS> doorbells_;
  SharedMapping memory_;  ///< of the ring
  std::unique_ptr<RingConsumer> ring_;
  uint64_t nonce_ = 0;
  std::map<uint32_t, std::shared_ptr<MappedSegment>> segments_;
  uint64_t lease_budget_ = 0;
  std::atomic<uint64_t> leased_bytes_{0};
  std::atomic<uint32_t> leases_{0};
  std::optional<LinkEnd> ended_;
  bool publisher_waits_ = false;
};

}  // namespace pi_os_transport
