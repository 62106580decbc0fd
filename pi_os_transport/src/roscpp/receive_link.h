#pragma once

#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "pi_os_transport/descriptor_ring.h"
#include "pi_os_transport/shared_memory.h"
#include "pi_os_transport/side_channel.h"
#include "runtime.h"

namespace pi_os_transport
{

class QueueWaiter;

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

/// The subscribing end of one link: merges what comes through the ring and over TCPROS into the publisher's order and
/// hands it to roscpp. A message lies in shared memory, leased, until roscpp has deserialised it; beyond the lease
/// budget it is copied to the heap at once.
///
/// Lifetime: shared by the tables, the watchers and every lease; the side channel stays open as long as this lives,
/// which tells the publisher that its memory is still being read.
class ReceiveLink : public std::enable_shared_from_this<ReceiveLink>
{
public:
  ReceiveLink(const ros::TransportPublisherLinkPtr& link, const ros::ConnectionPtr& connection)
    : link_(link), connection_(connection)
  {
  }

  /// Goes to fetch the shared memory that the publisher's header names. Network thread.
  void meet(const std::string& header_field);
  /// A message came over TCPROS; `deliver` hands it to roscpp. Network thread.
  template <typename Deliver>
  void deliverTcp(Deliver deliver)
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    drain(Drain::ALL_DUE);  // everything the publisher wrote before this message
    deliver();
    ++tcp_delivered_;
    drain(Drain::BATCH);
  }
  /// The TCPROS connection has ended. @param deliver_rest  hand over what the publisher left in the ring.
  void disconnect(bool deliver_rest);

  /// Hands over what is due, and has `doorbell` rung for what comes next. Any thread.
  void serve(Doorbell doorbell);

  /// True once the shared memory is mapped. Any thread.
  bool active() const { return active_.load(std::memory_order_acquire); }
  /// One line for getBusInfo.
  std::string info();

private:
  struct Lease;

  void onSocket();
  void onDoorbell();
  void onOffer(const Packet& packet, std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors);
  void joinWaiter();
  SideChannel::Receive readPackets();  // NOTHING when all are read, else why no more will come
  void unwatchSocket();
  enum class Drain
  {
    BATCH,    ///< what is due, but no more than one batch before the network thread serves its other sockets
    ALL_DUE,  ///< all that does not wait for a message from TCPROS
    REST,     ///< everything: nothing will come over TCPROS any more
  };
  void drain(Drain extent);
  void deliver(const ros::TransportPublisherLinkPtr& link, const Descriptor& descriptor, uint32_t place);
  boost::shared_array<uint8_t> fetch(const Descriptor& descriptor, uint32_t place);

  const boost::weak_ptr<ros::TransportPublisherLink> link_;
  const boost::weak_ptr<ros::Connection> connection_;

  std::recursive_mutex mutex_;  // recursive: a callback queue may run callbacks in place, which may end the link
  std::atomic<bool> active_{false};
  SideChannel channel_;
  bool socket_watched_ = false;
  std::array<FileDescriptor, DOORBELLS> doorbells_;  ///< by number, less one; empty once the link has ended
  std::shared_ptr<QueueWaiter> waiter_;
  SharedMapping memory_;  ///< of the ring
  std::unique_ptr<RingConsumer> ring_;
  Token pool_;
  std::map<uint32_t, std::shared_ptr<MappedSegment>> segments_;
  uint64_t lease_budget_ = 0;  ///< [B]
  std::atomic<uint64_t> leased_bytes_{0};
  std::atomic<uint32_t> leases_{0};
  uint32_t tcp_delivered_ = 0;  ///< messages delivered from TCPROS on this connection, modulo 2^32
  uint64_t received_ = 0;       ///< messages from the ring
  uint64_t copied_ = 0;         ///< of those, copied because too much was leased already
};

}  // namespace pi_os_transport
