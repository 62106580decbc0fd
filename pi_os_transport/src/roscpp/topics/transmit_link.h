#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "roscpp/fallback.h"
#include "roscpp/topics/overflow_queue.h"
#include "json.h"
#include "shm/ring_sender.h"
#include "shm/side_channel.h"
#include "roscpp/runtime.h"

namespace pi_os_transport
{

/// The publishing end of one link: decides message by message between the ring in shared memory and TCPROS, such that
/// the subscriber can restore the exact order, and keeps roscpp's outgoing queue semantics.
///
/// The other end of the ring is the subscriber, or the bridge of this device on behalf of a subscriber on another one.
/// In the second case nothing goes over TCPROS while the ring is in use: the two would overtake each other. What finds
/// no place waits here; when the bridge ends, it and what the bridge has not taken go over TCPROS, in order.
///
/// Lifetime: the connection's drop listener, the side channel's watcher and the tables share it. What the subscriber
/// still reads when the connection ends stays allocated until it closes the side channel, which its death does too.
class TransmitLink : public PoolLink, public std::enable_shared_from_this<TransmitLink>
{
public:
  TransmitLink(std::string topic, const ros::TransportSubscriberLinkPtr& link, const ros::ConnectionPtr& connection)
    : topic_(std::move(topic)), link_(link), connection_(connection)
  {
  }
  ~TransmitLink() override;

  const Token& token() const { return token_; }

  /// Replaces TransportSubscriberLink::enqueueMessage for serialised messages. Any thread.
  /// @param serial  as in Descriptor; not 0: within publish(), which flushes the OutboxWriter.
  void enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, uint64_t serial);

  /// True while messages go through shared memory. Any thread.
  bool active() const { return active_.load(std::memory_order_acquire); }
  /// What getBusInfo calls the link while it is active. Any thread.
  const char* transportName() const { return bridged_ ? BRIDGED_TRANSPORT_NAME : TRANSPORT_NAME; }

  /// The subscriber, or a bridge for it, has come: hands it the shared memory. Network thread.
  void meet(SideChannel channel, bool bridge);
  /// The TCPROS connection has ended. Any thread.
  void disconnect();

  /// Takes back what the subscriber has released, unless the link is busy. Any thread.
  void collectReleased() override;
  void retire(const std::vector<uint32_t>& segments) override;

  /// One line for getBusInfo.
  std::string info();
  /// Adds its counters to the state of the process. @return why it is on TCPROS, if it is.
  Fallback describe(JsonObject* object);

private:
  void onSocket();
  void onPeerGone();
  void closeChannel();
  void setActive(bool active);  // with mutex_ held
  void pushToTcp(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, size_t max_queue);
  void warnOfPool(ros::TransportSubscriberLink* link, size_t bytes);

  // On a link through a bridge, with mutex_ held.
  void startBridged();
  bool flushOverflow(size_t max_queue);  ///< as OverflowQueue::flush
  void returnToTcp();

  const std::string topic_;
  const boost::weak_ptr<ros::TransportSubscriberLink> link_;
  const boost::weak_ptr<ros::Connection> connection_;
  const Token token_ = Token::random();

  std::recursive_mutex mutex_;  // recursive: an allocation may collect what this link's subscriber has released
  std::atomic<bool> active_{false};
  std::atomic<bool> bridged_{false};
  bool ended_ = false;  ///< the TCPROS connection is gone; what the subscriber still reads is kept
  std::unique_ptr<RingSender> ring_;
  OverflowQueue overflow_;       ///< of a bridged link
  uint32_t tcp_pushed_ = 0;      ///< messages put into roscpp's outbox, modulo 2^32
  uint32_t tcp_dropped_ = 0;     ///< of those, dropped there
  uint64_t sent_before_ = 0;     ///< messages through earlier rings of this link
  uint64_t dropped_before_ = 0;  ///< of those, dropped because the subscriber did not take them in time
  bool pool_warned_ = false;
  uint64_t pool_full_ = 0;  ///< messages that found no memory in the pool
  Fallback fallback_ = Fallback::NEGOTIATING;
};

}  // namespace pi_os_transport
