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

/// One segment of a publisher's pool, mapped read-only. Shared by all links of this process to that publisher.
class MappedSegment
{
public:
  /// Maps `memory`; if the address space does not allow it, keeps the descriptor and reads through that.
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
/// The caller serialises all calls but release(). The publisher keeps what was taken until it is released or until the
/// side channel is closed, so this must live as long as anything taken from it is read.
class RingReceiver
{
public:
  explicit RingReceiver(SideChannel channel) : channel_(std::move(channel)) {}

  int fd() const { return channel_.fd(); }
  SideChannel& channel() { return channel_; }

  /// Reads all packets that wait. The first OFFER makes the ring, see hasRing().
  /// @return NOTHING when all are read, else why no more will come.
  SideChannel::Receive readPackets();
  bool hasRing() const { return ring_ != nullptr; }
  /// Tells the publisher that the ring is mapped. Before this it writes no message.
  bool sendProof();
  /// The reason that came with ENDED, if it has come.
  const std::optional<LinkEnd>& ended() const { return ended_; }

  /// True once after the publisher said that messages wait for a place in the ring.
  bool takePublisherWaits() { return std::exchange(publisher_waits_, false); }

  /// Only with a ring.
  RingConsumer& ring() { return *ring_; }
  /// What to wait on for Doorbell `number`; -1 once closed.
  int doorbell(Doorbell number) const { return doorbells_[number - 1].get(); }
  void closeDoorbells() { doorbells_ = {}; }

  /// Where a message that was taken lies. Reads packets if its segment is not known yet.
  /// @return the segment; null if the descriptor points nowhere.
  std::shared_ptr<MappedSegment> find(const Descriptor& descriptor);

  /// Shared memory that may be held at a time [B].
  uint64_t leaseBudget() const { return lease_budget_; }
  /// Counts a message that is read where it lies; release() ends it. Any thread.
  void lease(uint32_t length);
  void endLease(uint32_t ticket, uint32_t length);
  uint64_t leasedBytes() const { return leased_bytes_.load(std::memory_order_relaxed); }
  uint32_t leases() const { return leases_.load(std::memory_order_relaxed); }
  /// Gives a message back. Any thread.
  void release(uint32_t ticket) { ring_->release(ticket); }

private:
  void onOffer(const Packet& packet, std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors);

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
