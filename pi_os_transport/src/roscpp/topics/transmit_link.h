#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "roscpp/fallback.h"
#include "roscpp/runtime.h"
#include "roscpp/topics/overflow_queue.h"
#include "shm/ring_sender.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// The publishing end of one link. Sends each message through the ring in shared memory or over TCPROS, in a way that
/// lets the subscriber restore the order, and keeps the semantics of roscpp's outgoing queue.
///
/// The other end of the ring is the subscriber, or the bridge of this device for a subscriber on another device. While
/// a bridge uses the ring, nothing is sent over TCPROS, because messages could overtake each other. Messages without a
/// place wait here. When the bridge ends, these and the messages that the bridge has not released use TCPROS, in order
/// and with their numbers: the subscriber may have some of them.
///
/// Lifetime: owned by the connection's drop listener, the pair of processes and the tables. Messages that the
/// subscriber still reads when the connection ends stay allocated until it ends its link or dies.
class TransmitLink : public PairLink, public PoolLink, public std::enable_shared_from_this<TransmitLink>
{
public:
  TransmitLink(std::string topic, const ros::TransportSubscriberLinkPtr& link, const ros::ConnectionPtr& connection)
    : topic_(std::move(topic)), link_(link), connection_(connection)
  {
  }
  ~TransmitLink() override;

  const Token& token() const { return token_; }
  /// Call before the first message: nothing goes over TCPROS, messages wait for a bridge.
  void requireBridge() { requires_bridge_ = true; }

  /// Replaces TransportSubscriberLink::enqueueMessage for serialised messages. Any thread.
  /// @param serial  as in Descriptor; not 0 inside publish(), which flushes the OutboxWriter.
  void enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, uint64_t serial);

  /// True while messages use shared memory. Any thread.
  bool active() const { return active_.load(std::memory_order_acquire); }
  /// Transport in getBusInfo while the link is active. Any thread.
  const char* transportName() const { return bridged_ ? BRIDGED_TRANSPORT_NAME : TRANSPORT_NAME; }

  /// The subscriber, or its bridge, asks for the shared memory. Network thread.
  void meet(const std::shared_ptr<ProcessPair>& pair, const Packet& hello);
  /// The TCPROS connection has ended. Any thread.
  void disconnect();

  /// Takes back what the subscriber has released, unless the link is busy. Any thread.
  void collectReleased() override { collectReleasedFrom(ring_, &mutex_); }
  void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) override;
  void onPairEnded() override;

  /// One line for getBusInfo.
  std::string info();
  /// Adds the counters of the link to `object`. @return why the link uses TCPROS, if it does.
  Fallback describe(nlohmann::ordered_json* object);

private:
  void onDeclined();
  void closeRing();
  void setActive(bool active);  // with mutex_ held
  void pushToTcp(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, size_t max_queue);
  bool pushOrQueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, uint64_t serial,
                   size_t max_queue, bool* pool_full);
  void warnOfPool(ros::TransportSubscriberLink* link, size_t bytes);

  // With mutex_ held: what waits in the ring goes into roscpp's outbox.
  void returnToTcp();
  void returnUntaken(ros::TransportSubscriberLink* link);
  void returnNumbered(ros::TransportSubscriberLink* link);
  void keepForNextBridge();

  // On a link through a bridge, with mutex_ held.
  void startBridged();
  void hold(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, uint64_t serial,
            size_t max_queue);

  const std::string topic_;
  const boost::weak_ptr<ros::TransportSubscriberLink> link_;
  const boost::weak_ptr<ros::Connection> connection_;
  const Token token_ = Token::random();

  std::recursive_mutex mutex_;  // recursive: an allocation may call collectReleased()
  std::atomic<bool> active_{false};
  std::atomic<bool> bridged_{false};
  bool ended_ = false;  ///< the TCPROS connection has ended
  std::unique_ptr<RingSender> ring_;
  OverflowQueue overflow_;       ///< of a bridged link
  uint32_t last_number_ = 0;     ///< of the messages for bridges, modulo 2^32
  size_t returned_ = 0;          ///< at most so many messages in roscpp's outbox came back from a bridge
  uint32_t tcp_pushed_ = 0;      ///< messages put into roscpp's outbox, modulo 2^32
  uint32_t tcp_dropped_ = 0;     ///< of those, dropped there
  uint64_t sent_before_ = 0;     ///< messages through earlier rings of this link
  uint64_t dropped_before_ = 0;  ///< of those, dropped before the subscriber took them
  bool requires_bridge_ = false;
  bool hold_warned_ = false;
  std::chrono::steady_clock::time_point born_ = std::chrono::steady_clock::now();
  uint64_t pool_full_ = 0;  ///< messages that found the pool full
  Fallback fallback_ = Fallback::NEGOTIATING;
};

}  // namespace pi_os_transport
