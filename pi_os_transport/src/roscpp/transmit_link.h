#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "pi_os_transport/descriptor_ring.h"
#include "pi_os_transport/shared_memory.h"
#include "pi_os_transport/side_channel.h"
#include "runtime.h"

namespace pi_os_transport
{

/// The publishing end of one link: decides message by message between the ring in shared memory and TCPROS, such that
/// the subscriber can restore the exact order, and keeps roscpp's outgoing queue semantics.
///
/// Lifetime: the connection's drop listener, the side channel's watcher and the tables share it. What the subscriber
/// still reads when the connection ends stays allocated until it closes the side channel, which its death does too.
class TransmitLink : public std::enable_shared_from_this<TransmitLink>
{
public:
  TransmitLink(std::string topic, const ros::ConnectionPtr& connection)
    : topic_(std::move(topic)), connection_(connection)
  {
  }
  ~TransmitLink();

  const Token& token() const { return token_; }

  /// Replaces TransportSubscriberLink::enqueueMessage for serialised messages. Any thread.
  void enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message);

  /// True while messages go through shared memory. Any thread.
  bool active() const { return active_.load(std::memory_order_acquire); }

  /// The subscriber has come: hands it the shared memory. Network thread.
  void meet(SideChannel channel);
  /// The TCPROS connection has ended. Any thread.
  void disconnect();

  /// Takes back what the subscriber has released, unless the link is busy. Any thread.
  void collectReleased();
  void retire(const std::vector<uint32_t>& segments);

  /// One line for getBusInfo.
  std::string info();

private:
  void onSocket();
  void onPeerGone();
  void closeChannel();
  void setActive(bool active);  // with mutex_ held
  void collect();               // with mutex_ held
  bool announce(uint32_t segment);
  /// With mutex_ held. True if the ring took over one reference of `buffer`.
  bool pushToRing(const uint8_t* buffer, uint32_t length, size_t max_queue, uint32_t after_tcp, uint32_t* doorbell);
  void pushToTcp(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, size_t max_queue);

  const std::string topic_;
  const boost::weak_ptr<ros::Connection> connection_;
  const Token token_ = Token::random();

  std::mutex mutex_;
  std::atomic<bool> active_{false};
  bool ended_ = false;  ///< the TCPROS connection is gone; what the subscriber still reads is kept
  SideChannel channel_;
  std::array<FileDescriptor, DOORBELLS> doorbells_;
  SharedMapping memory_;  ///< of the ring
  std::unique_ptr<RingProducer> ring_;
  uint64_t nonce_ = 0;
  std::vector<const uint8_t*> buffers_;  ///< by place in the ring: what the reference is held for
  std::vector<uint32_t> lengths_;        ///< by place [B]
  std::vector<uint32_t> announced_;      ///< segments whose memory the subscriber was given
  uint32_t tail_ = 0;                    ///< index of the next message in the ring
  uint32_t tcp_pushed_ = 0;              ///< messages put into roscpp's outbox, modulo 2^32
  uint32_t tcp_dropped_ = 0;             ///< of those, dropped there
  uint64_t sent_ = 0;                    ///< messages through the ring
  uint64_t dropped_ = 0;                 ///< of those, dropped because the subscriber did not take them in time
  bool pool_warned_ = false;
};

}  // namespace pi_os_transport
