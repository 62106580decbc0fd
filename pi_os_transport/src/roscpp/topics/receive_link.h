#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>

#include "roscpp/fallback.h"
#include "json.h"
#include "shm/latency_histogram.h"
#include "shm/ring_receiver.h"
#include "shm/side_channel.h"
#include "roscpp/queue_waiter.h"
#include "roscpp/runtime.h"

namespace pi_os_transport
{

/// The subscribing end of one link: merges what comes through the ring and over TCPROS into the publisher's order and
/// hands it to roscpp. A message lies in shared memory, leased, until roscpp has deserialised it; beyond the lease
/// budget it is copied to the heap at once.
///
/// The other end of the ring is the publisher, or the bridge of this device when the publisher runs on another one.
///
/// Lifetime: shared by the tables, the watchers and every lease; the side channel stays open as long as a lease lives,
/// which tells the publisher that its memory is still being read.
class ReceiveLink : public QueueSource, public std::enable_shared_from_this<ReceiveLink>
{
public:
  ReceiveLink(const ros::TransportPublisherLinkPtr& link, const ros::ConnectionPtr& connection)
    : link_(link), connection_(connection)
  {
  }

  /// Goes to fetch the shared memory that the publisher's header names. Network thread.
  void meet(const std::string& header_field);
  /// Asks this device's bridge for the link. Network thread.
  /// @return false if no bridge answers: to be tried again.
  bool askBridge();
  /// A message came over TCPROS; `deliver` hands it to roscpp. Network thread.
  template <typename Deliver>
  void deliverTcp(Deliver deliver)
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (started_ && static_cast<int32_t>(tcp_delivered_ - tcp_before_start_) >= 0)
    {
      leaveBridge();  // the publisher has gone back to TCPROS
    }
    drain(Drain::ALL_DUE);  // everything the publisher wrote before this message
    deliver();
    ++tcp_delivered_;
    drain(Drain::BATCH);
  }
  /// The TCPROS connection has ended. @param deliver_rest  hand over what the publisher left in the ring.
  void disconnect(bool deliver_rest);

  void serve(Doorbell doorbell) override;

  /// True once the shared memory is mapped. Any thread.
  bool active() const { return active_.load(std::memory_order_acquire); }
  /// What getBusInfo calls the link while it is active. Any thread.
  const char* transportName() const { return bridged_ ? BRIDGED_TRANSPORT_NAME : TRANSPORT_NAME; }
  /// One line for getBusInfo.
  std::string info();
  /// Adds its counters to the state of the process. @return why it is on TCPROS, if it is.
  Fallback describe(JsonObject* object);

  /// A message taken from `ring`: where it lies, leased, or beyond the lease budget as a copy, which `*copied` counts.
  /// The caller serialises it with the other calls of `ring`. `held` counts those that zero-copy subscribers hold;
  /// null: they get none of it. @return null if its memory cannot be read.
  static boost::shared_array<uint8_t> fetch(const std::shared_ptr<RingReceiver>& ring, const Descriptor& descriptor,
                                            uint32_t ticket, uint64_t* copied,
                                            const std::shared_ptr<std::atomic<uint64_t>>& held = nullptr);

private:
  struct Lease;

  void use(SideChannel channel);
  void onSocket();
  void onDoorbell();
  void onOffer();
  void joinWaiter();
  void unwatchSocket();
  void closeRing();
  void leaveBridge();
  enum class Drain
  {
    BATCH,    ///< what is due, but no more than one batch before the network thread serves its other sockets
    ALL_DUE,  ///< all that does not wait for a message from TCPROS
    REST,     ///< everything: nothing will come over TCPROS any more
  };
  void drain(Drain extent);
  void deliver(const ros::TransportPublisherLinkPtr& link, const Descriptor& descriptor, uint32_t ticket);

  const boost::weak_ptr<ros::TransportPublisherLink> link_;
  const boost::weak_ptr<ros::Connection> connection_;

  std::recursive_mutex mutex_;  // recursive: a callback queue may run callbacks in place, which may end the link
  std::atomic<bool> active_{false};
  std::atomic<bool> bridged_{false};
  bool ended_ = false;  ///< the TCPROS connection is gone
  Token socket_token_;  ///< of the publisher's process
  Token link_token_;
  std::shared_ptr<RingReceiver> ring_;  ///< shared with the leases; may have no ring yet
  bool socket_watched_ = false;
  bool in_use_ = false;  ///< the ring's doorbells are watched
  std::shared_ptr<QueueWaiter> waiter_;
  bool started_ = false;           ///< a link through bridges has carried its first descriptor
  uint32_t tcp_before_start_ = 0;  ///< messages that the publisher sent over TCPROS before, modulo 2^32
  uint32_t tcp_delivered_ = 0;     ///< messages delivered from TCPROS on this connection, modulo 2^32
  uint64_t received_ = 0;          ///< messages from the ring
  /// Of those, read by zero-copy subscribers where they lie.
  const std::shared_ptr<std::atomic<uint64_t>> held_ = std::make_shared<std::atomic<uint64_t>>();
  uint64_t copied_ = 0;         ///< of those, copied because too much was leased already
  LatencyHistogram latencies_;  ///< from the ring's writing to the taking
  Fallback fallback_ = Fallback::PEER_SILENT;
  uint64_t late_ = 0;  ///< messages from a bridge that newer ones over TCPROS had overtaken; not delivered
};

}  // namespace pi_os_transport
