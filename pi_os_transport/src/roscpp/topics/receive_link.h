#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "roscpp/fallback.h"
#include "roscpp/queue_waiter.h"
#include "roscpp/runtime.h"
#include "shm/latency_histogram.h"
#include "shm/ring_receiver.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// The subscribing end of one link. Merges the messages from the ring and from TCPROS into the publisher's order and
/// passes them to roscpp. A message is leased in shared memory until roscpp has deserialised it; beyond the lease
/// budget it is copied to the heap.
///
/// The other end of the ring is the publisher, or the bridge of this device if the publisher is on another device.
///
/// Lifetime: owned by the tables and the pair of processes. Every lease keeps the RingReceiver, whose end tells the
/// publisher that its memory is no longer read.
class ReceiveLink : public PairLink, public std::enable_shared_from_this<ReceiveLink>
{
public:
  ReceiveLink(const ros::TransportPublisherLinkPtr& link, const ros::ConnectionPtr& connection)
    : link_(link), publisher_link_(link.get()), connection_(connection)
  {
  }

  /// Fetches the shared memory that the publisher's header offers. Network thread.
  void meet(const std::string& header_field);
  /// Asks this device's bridge for the link. Network thread.
  /// @return false if no bridge answers: try again later.
  bool askBridge();
  /// A message came over TCPROS: passes it to roscpp, unless a bridge has delivered it. Network thread.
  /// @param link  null: the message is only counted.
  void deliverTcp(ros::TransportPublisherLink* link, const ros::SerializedMessage& message);
  /// The TCPROS connection has ended. @param deliver_rest  deliver the rest of the ring.
  void disconnect(bool deliver_rest);
  /// Whether the subscription still wants what its publisher has sent. Any thread.
  bool isWanted() const;

  void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) override;
  void onPairEnded() override;
  void serve() override;

  /// True once the shared memory is mapped. Any thread.
  bool active() const { return active_.load(std::memory_order_acquire); }
  /// Transport in getBusInfo while the link is active. Any thread.
  const char* transportName() const { return bridged_ ? BRIDGED_TRANSPORT_NAME : TRANSPORT_NAME; }
  /// One line for getBusInfo.
  std::string info();
  /// Adds the counters of the link to `object`. @return why the link uses TCPROS, if it does.
  Fallback describe(nlohmann::ordered_json* object);

private:
  bool use(const std::shared_ptr<ProcessPair>& pair);
  void onOffer(const Packet& packet, SideChannel::Descriptors* descriptors);
  void onEnded(LinkEnd reason);
  void joinWaiter();
  void decline();
  void closeRing();
  void leaveBridge(LinkEnd reason);
  void forgetEnding();
  enum class Drain
  {
    BATCH,    ///< what is due, at most one batch before the network thread serves its other sockets
    ALL_DUE,  ///< everything that does not wait for a message from TCPROS
    REST,     ///< everything: no more messages come over TCPROS
  };
  void drain(Drain extent);
  bool isNew(uint32_t number);
  void deliver(const ros::TransportPublisherLinkPtr& link, const RingReceiver::Message& message);

  const boost::weak_ptr<ros::TransportPublisherLink> link_;
  const ros::TransportPublisherLink* const publisher_link_;  ///< the same, as a key also behind its end
  const boost::weak_ptr<ros::Connection> connection_;

  std::recursive_mutex mutex_;  // recursive: a callback that runs in place may end the link
  std::atomic<bool> active_{false};
  std::atomic<bool> bridged_{false};
  bool ended_ = false;  ///< the TCPROS connection is gone
  /// Until the last message that a bridge carries has come: the ROS master may say before that the publisher is gone.
  ros::TransportPublisherLinkPtr ending_;
  Token socket_token_;  ///< of the publisher's process
  Token link_token_;
  std::shared_ptr<RingReceiver> ring_;  ///< shared with the leases; may have no ring yet
  bool in_use_ = false;                 ///< messages are taken from the ring
  std::shared_ptr<QueueWaiter> waiter_;
  bool started_ = false;           ///< a link through bridges has carried its first descriptor
  uint32_t tcp_before_start_ = 0;  ///< messages sent over TCPROS before that, modulo 2^32
  bool bridge_ended_ = false;      ///< before the link had started: messages over TCPROS come first
  uint32_t tcp_delivered_ = 0;     ///< messages delivered from TCPROS on this connection, modulo 2^32
  uint64_t received_ = 0;          ///< messages from the ring
  /// Of those, held by zero-copy subscribers.
  const std::shared_ptr<std::atomic<uint64_t>> held_ = std::make_shared<std::atomic<uint64_t>>();
  uint64_t copied_ = 0;         ///< of those, copied because too many were leased
  LatencyHistogram latencies_;  ///< from writing into the ring to taking
  Fallback fallback_ = Fallback::PEER_SILENT;
  uint64_t late_ = 0;         ///< messages from a bridge, not delivered because newer ones came over TCPROS
  uint32_t last_number_ = 0;  ///< of the messages from bridges, modulo 2^32
  uint64_t missing_ = 0;      ///< messages for bridges that were dropped on the way
};

}  // namespace pi_os_transport
