#include "roscpp/topics/receive_link.h"

#include <ros/console.h>
#include <ros/subscription.h>
#include <ros/this_node.h>
#include <ros/transport/transport_tcp.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include <nlohmann/json.hpp>

#include "roscpp/bridge_client.h"
#include "roscpp/topics/fetched_message.h"
#include "roscpp/topics/header_offer.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

/// Messages delivered before the network thread serves its other sockets.
constexpr uint32_t BATCH = 64;
/// When a link asks for a bridge again: after no answer or its end, and after a refusal of this topic.
constexpr std::chrono::milliseconds ASK_AGAIN{300};
constexpr std::chrono::milliseconds ASK_AGAIN_REFUSED{5000};

}  // namespace

void ReceiveLink::meet(const std::string& header_field)
{
  const std::optional<HeaderOffer> offer = HeaderOffer::parse(header_field);
  Fallback reason = Fallback::PEER_VERSION;
  const std::shared_ptr<ProcessPair> pair = offer ? Runtime::instance().pairWith(offer->socket, &reason) : nullptr;
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  fallback_ = pair ? Fallback::NEGOTIATING : reason;
  if (!offer)
  {
    return;
  }
  socket_token_ = offer->socket;
  link_token_ = offer->link;
  if (pair)
  {
    if (!use(pair) || !ring_->sendHello(link_token_))
    {
      fallback_ = Fallback::NO_MEMORY;
    }
  }
  else if (!askBridge())  // the publisher is on another device, in another container, or of another user
  {
    BridgeClient::instance().want(shared_from_this(), ASK_AGAIN);
  }
}

bool ReceiveLink::askBridge()
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  const ros::TransportPublisherLinkPtr link = link_.lock();
  const ros::SubscriptionPtr subscription = link ? link->parent_.lock() : nullptr;
  const ros::ConnectionPtr connection = connection_.lock();
  const auto transport =
      connection ? boost::dynamic_pointer_cast<ros::TransportTCP>(connection->getTransport()) : nullptr;
  if (ended_ || ring_ || !subscription || !transport)
  {
    return true;  // nothing to request
  }
  BridgeRequest request;
  request.kind = BridgeRequest::LINK;
  request.address = BridgeClient::peerAddress(transport->sock_);
  request.socket_token = socket_token_.toString();
  request.link_token = link_token_.toString();
  request.topic = subscription->getName();
  request.type = subscription->datatype();
  request.publisher = link->getCallerID();
  request.subscriber = ros::this_node::getName();
  if (request.address.empty())
  {
    return true;
  }
  const std::shared_ptr<ProcessPair> pair = Runtime::instance().pairWithBridge();
  if (!pair)
  {
    return false;
  }
  bridged_ = true;
  if (use(pair))
  {
    request.link = ring_->number();
    ring_->pair().sendBytes(request.encode());
  }
  return true;
}

bool ReceiveLink::use(const std::shared_ptr<ProcessPair>& pair)
{
  ring_ = std::make_shared<RingReceiver>(pair, shared_from_this());
  return ring_->number() != 0;
}

void ReceiveLink::onPacket(const Packet& packet, SideChannel::Descriptors* descriptors)
{
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (!ring_ || packet.link != ring_->number())
    {
      return;  // about an earlier ring of this link
    }
    if (packet.type == Packet::OFFER && !ring_->hasRing())
    {
      onOffer(packet, descriptors);
    }
  }
  if (packet.type == Packet::ENDED)
  {
    onEnded(static_cast<LinkEnd>(packet.values[0]));
  }
}

void ReceiveLink::onOffer(const Packet& packet, SideChannel::Descriptors* descriptors)
{
  if (!ring_->onOffer(packet, descriptors))
  {
    const std::string shortage = describeShortage(errno);
    if (descriptors->front() && !shortage.empty())
    {
      Runtime::instance().warnOfShortage("no room for a ring in shared memory: " + shortage);
    }
    fallback_ = Fallback::NO_MEMORY;
    decline();
    return;
  }
  in_use_ = true;
  joinWaiter();
  drain(Drain::BATCH);  // arms the doorbell before the first message can be written
  active_.store(in_use_ && ring_->sendProof(), std::memory_order_release);
}

void ReceiveLink::onEnded(LinkEnd reason)
{
  bool bridged = false;
  bool was_active = false;
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    bridged = bridged_;
    was_active = active();
    if (bridged)
    {
      leaveBridge(reason);
    }
    else if (ring_)
    {
      drain(Drain::ALL_DUE);
      fallback_ = reason == LinkEnd::REFUSED ? Fallback::NO_MEMORY : Fallback::BROKEN;
      closeRing();
      ring_.reset();
    }
  }
  const ros::ConnectionPtr connection = connection_.lock();
  if (reason == LinkEnd::PUBLISHER_UNAWARE && bridged && connection)
  {
    BridgeClient::instance().reconnect(connection);  // the publisher restarts the link
  }
  else if (reason == LinkEnd::CLOSED && (bridged || was_active))
  {
    dropIfSilent(connection);
  }
}

void ReceiveLink::onPairEnded()
{
  bool silence_is_death = false;
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (bridged_)
    {
      leaveBridge(LinkEnd::BACK_TO_TCP);  // the end of a bridge tells nothing about the publisher
    }
    else if (ring_)
    {
      // Without a word from the publisher, it had no room for this process: the link stays on TCPROS.
      silence_is_death = ring_->pair().met();
      drain(Drain::ALL_DUE);
    }
  }
  if (silence_is_death)
  {
    dropIfSilent(connection_.lock());
  }
}

/// The ring, or its memory, finds no room in this process. What has not been taken comes over TCPROS.
void ReceiveLink::decline()
{
  fallback_ = Fallback::NO_MEMORY;
  ring_->decline();
  closeRing();
  ring_.reset();
}

void ReceiveLink::joinWaiter()
{
  const ros::TransportPublisherLinkPtr link = link_.lock();
  const ros::SubscriptionPtr subscription = link ? link->parent_.lock() : nullptr;
  if (!subscription)
  {
    return;
  }
  boost::mutex::scoped_lock lock(subscription->callbacks_mutex_);
  if (subscription->callbacks_.empty())
  {
    return;
  }
  // If the subscription has several queues, all are served while a thread waits on the first.
  if (auto* queue = dynamic_cast<ros::CallbackQueue*>(subscription->callbacks_.front()->callback_queue_))
  {
    waiter_ = QueueWaiter::of(queue);
    ring_->ring().useDoorbell(waiter_->join());
  }
}

void ReceiveLink::serve()
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  drain(Drain::BATCH);
}

void ReceiveLink::closeRing()
{
  if (!ring_)
  {
    return;
  }
  ring_->detach();
  in_use_ = false;
  if (const std::shared_ptr<QueueWaiter> waiter = std::exchange(waiter_, nullptr))
  {
    waiter->leave();
  }
  active_.store(false, std::memory_order_release);
}

void ReceiveLink::leaveBridge(LinkEnd reason)
{
  if (!bridged_)
  {
    return;
  }
  drain(ended_ ? Drain::REST : Drain::ALL_DUE);
  if (!ended_ && in_use_ && !started_ && ring_->ring().available() > 0)
  {
    bridge_ended_ = true;
    return;  // its start waits for a message over TCPROS; this is called again after that
  }
  bridge_ended_ = false;
  closeRing();
  ring_.reset();
  bridged_ = false;
  started_ = false;
  forgetEnding();
  if (!ended_)
  {
    BridgeClient::instance().want(shared_from_this(), reason == LinkEnd::REFUSED ? ASK_AGAIN_REFUSED : ASK_AGAIN);
  }
}

bool ReceiveLink::isWanted() const
{
  const ros::TransportPublisherLinkPtr link = link_.lock();
  const ros::SubscriptionPtr subscription = link ? link->parent_.lock() : nullptr;
  return subscription && !subscription->dropped_ && !subscription->shutting_down_;
}

void ReceiveLink::disconnect(bool deliver_rest)
{
  const std::shared_ptr<ReceiveLink> self = shared_from_this();  // the pair may hold the last reference
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  ended_ = true;
  if (deliver_rest)
  {
    drain(Drain::REST);
    if (bridged_ && in_use_ && !bridge_ended_)
    {
      active_.store(false, std::memory_order_release);
      ending_ = link_.lock();
      Runtime::instance().ending_receive_links.insert(publisher_link_, self);
      return;  // messages under way between the devices follow; the bridge reports the end
    }
  }
  closeRing();
  ring_.reset();  // unless a message is being read, the publisher gets everything back
  forgetEnding();
}

void ReceiveLink::forgetEnding()
{
  auto& links = Runtime::instance().ending_receive_links;
  if (ended_ && links.find(publisher_link_).get() == this)
  {
    links.erase(publisher_link_);
  }
  ending_.reset();
}

void ReceiveLink::drain(Drain extent)
{
  const ros::TransportPublisherLinkPtr link = in_use_ ? link_.lock() : nullptr;
  if (!link)
  {
    return;
  }
  // Keeps the ring alive: a callback that runs in place may end the link.
  const std::shared_ptr<RingReceiver> ring = ring_;
  // Never more than the ring holds: a publisher with a wrong tail must not occupy this thread forever.
  for (uint32_t taken = 0; in_use_ && ring == ring_ && taken <= RingLayout::CAPACITY; ++taken)
  {
    if (taken == BATCH && extent == Drain::BATCH &&
        Runtime::instance().later([self = shared_from_this()]() { self->serve(); }))
    {
      return;  // the network thread goes on after serving its other sockets
    }
    RingReceiver::Message message;
    const bool in_any_order = extent == Drain::REST || ended_ || started_;
    const RingReceiver::Take take = ring->take(tcp_delivered_, in_any_order, &message);
    if (take == RingReceiver::Take::UNREADABLE)
    {
      decline();
    }
    if (take != RingReceiver::Take::TAKEN)
    {
      if (ring->ring().broken())
      {
        ROS_ERROR_ONCE("pi_os_transport: [%s] broke a shared ring: nothing more is received through it; restart it",
                       link->getCallerID().c_str());
      }
      return;
    }
    if (message.descriptor.segment == Descriptor::LINK_START)
    {
      started_ = true;
      tcp_before_start_ = message.descriptor.after_tcp;
      ring->release(message.ticket);
      continue;
    }
    const bool late = bridged_ && static_cast<int32_t>(tcp_delivered_ - tcp_before_start_) > 0;
    if (late || (bridged_ && !isNew(message.descriptor.after_tcp)))
    {
      late_ += late ? 1 : 0;
      ring->release(message.ticket);
      continue;
    }
    deliver(link, message);
  }
}

void ReceiveLink::deliver(const ros::TransportPublisherLinkPtr& link, const RingReceiver::Message& message)
{
  const uint32_t length = message.descriptor.length;
  boost::shared_array<uint8_t> buffer = fetchMessage(ring_, message, &copied_, held_);
  if (!buffer)
  {
    ROS_ERROR_ONCE("pi_os_transport: lost a message of %u bytes from [%s]: its shared memory cannot be read", length,
                   link->getCallerID().c_str());
    return;
  }
  ++received_;
  latencies_.addSince(message.descriptor.stamp_ns);
  Runtime::instance().original.handle_message(link.get(), ros::SerializedMessage(buffer, length), true, false);
}

Fallback ReceiveLink::describe(nlohmann::ordered_json* object)
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  object->update({{"memory", received_},
                  {"tcp", tcp_delivered_},
                  {"copied", copied_},
                  {"late", late_},
                  {"missing", missing_},
                  {"waiting", in_use_ ? ring_->ring().available() : 0},
                  {"leased_bytes", ring_ ? ring_->leasedBytes() : 0},
                  {"latencies", latencies_.counts()}});
  return active() ? Fallback::NONE : fallback_;
}

std::string ReceiveLink::info()
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  return std::string(transportName()) + " ring (" + std::to_string(received_) + " messages through shared memory, " +
         std::to_string(*held_) + " read in place, " + std::to_string(copied_) + " copied, " +
         (late_ > 0 ? std::to_string(late_) + " too late, " : std::string()) + std::to_string(tcp_delivered_) +
         " through TCPROS)";
}

}  // namespace pi_os_transport
