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
#include "roscpp/held_leases.h"
#include "roscpp/topics/header_offer.h"
#include "shm/event.h"

namespace pi_os_transport
{
namespace
{

/// Most leased messages; further ones are copied. The ring has tickets for twice as many.
constexpr uint32_t MAX_LEASES = RingLayout::CAPACITY / 2;
/// Messages delivered before the network thread serves its other sockets.
constexpr uint32_t BATCH = 64;
/// When a link asks for a bridge again: after no answer or its end, and after a refusal of this topic.
constexpr std::chrono::milliseconds ASK_AGAIN{300};
constexpr std::chrono::milliseconds ASK_AGAIN_REFUSED{5000};

}  // namespace

/// Deleter of a leased buffer: returns it to the publisher.
struct ReceiveLink::Lease
{
  std::shared_ptr<RingReceiver> ring;
  std::shared_ptr<MappedSegment> segment;
  uint32_t ticket;
  uint32_t length;

  void operator()(uint8_t*) const
  {
    if (Runtime::instance().active())
    {
      ring->endLease(ticket, length);
    }
  }
};

namespace
{

/// A message for roscpp. @param end  called after the last user. @param held  counts held messages; null: the message
/// cannot be held.
template <typename End>
boost::shared_array<uint8_t> makeHoldable(uint8_t* message, const End& end,
                                          const std::shared_ptr<std::atomic<uint64_t>>& held)
{
  if (!held || !HeldLeases::instance().wanted())
  {
    return boost::shared_array<uint8_t>(message, end);
  }
  std::shared_ptr<HeldLease> lease = HeldLeases::instance().add(
      message, [end, message]() { end(message); }, held);
  return boost::shared_array<uint8_t>(message, [lease](uint8_t*) mutable { lease.reset(); });
}

}  // namespace

void ReceiveLink::meet(const std::string& header_field)
{
  const std::optional<HeaderOffer> offer = HeaderOffer::parse(header_field);
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  fallback_ = offer ? Fallback::NEGOTIATING : Fallback::PEER_VERSION;
  if (!offer)
  {
    return;
  }
  socket_token_ = offer->socket;
  link_token_ = offer->link;
  SideChannel channel = SideChannel::connect(HeaderOffer::socketName(offer->socket));
  if (!channel)
  {
    fallback_ = errno == EPERM ? Fallback::OTHER_USER : Fallback::UNREACHABLE;
  }
  if (channel && channel.send(offer->hello()))
  {
    use(std::move(channel));
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
  SideChannel channel = BridgeClient::instance().connect(request);
  if (!channel)
  {
    return false;
  }
  bridged_ = true;
  use(std::move(channel));
  return true;
}

void ReceiveLink::use(SideChannel channel)
{
  ring_ = std::make_shared<RingReceiver>(std::move(channel));
  socket_watched_ = true;
  Runtime::instance().watch(ring_->fd(), [self = shared_from_this()](int) { self->onSocket(); });
}

void ReceiveLink::onSocket()
{
  bool silence_is_death = true;
  bool unaware = false;
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (!socket_watched_)
    {
      return;
    }
    const SideChannel::Receive end = ring_->readPackets();
    if (ring_->hasRing() && !in_use_)
    {
      onOffer();
    }
    if (end == SideChannel::Receive::NOTHING)
    {
      return;
    }
    unwatchSocket();
    if (bridged_)
    {
      // The end of a bridge tells nothing about the publisher, unless its reason does.
      const std::optional<LinkEnd> reason = ring_->ended();
      silence_is_death = reason == LinkEnd::CLOSED;
      unaware = reason == LinkEnd::PUBLISHER_UNAWARE;
      leaveBridge();
    }
    else if (end == SideChannel::Receive::MALFORMED && !active())
    {
      return;  // without a proof from this side the link stays on TCPROS
    }
    else
    {
      drain(Drain::ALL_DUE);
    }
  }
  const ros::ConnectionPtr connection = connection_.lock();
  if (unaware && connection)
  {
    BridgeClient::instance().reconnect(connection);  // the publisher restarts the link
  }
  else if (silence_is_death)
  {
    dropIfSilent(connection);
  }
}

void ReceiveLink::onOffer()
{
  in_use_ = true;
  Runtime::instance().watch(ring_->doorbell(NETWORK_THREAD), [self = shared_from_this()](int) { self->onDoorbell(); });
  drain(Drain::BATCH);  // arms the doorbell before the first message can be written
  joinWaiter();
  active_.store(ring_->sendProof(), std::memory_order_release);
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
    waiter_->add(shared_from_this(), ring_->doorbell(SPINNER));
  }
}

void ReceiveLink::serve(Doorbell doorbell)
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (in_use_)
  {
    ring_->ring().useDoorbell(doorbell);
    drain(Drain::BATCH);
  }
}

void ReceiveLink::onDoorbell()
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (in_use_ && clearEvent(ring_->doorbell(NETWORK_THREAD)))
  {
    drain(Drain::BATCH);
  }
}

void ReceiveLink::unwatchSocket()
{
  if (std::exchange(socket_watched_, false))
  {
    Runtime::instance().unwatch(ring_->fd());
  }
}

void ReceiveLink::closeRing()
{
  if (!ring_)
  {
    return;
  }
  unwatchSocket();
  if (std::exchange(in_use_, false))
  {
    Runtime::instance().unwatch(ring_->doorbell(NETWORK_THREAD));
    if (const std::shared_ptr<QueueWaiter> waiter = std::exchange(waiter_, nullptr))
    {
      waiter->remove(shared_from_this(), ring_->doorbell(SPINNER));
    }
    ring_->closeDoorbells();
  }
  active_.store(false, std::memory_order_release);
}

void ReceiveLink::leaveBridge()
{
  if (!bridged_)
  {
    return;
  }
  drain(ended_ ? Drain::REST : Drain::ALL_DUE);
  if (!ended_ && in_use_ && !started_ && ring_->ring().available() > 0)
  {
    return;  // its start waits for a message over TCPROS; this is called again after that
  }
  const bool refused = ring_->ended() == LinkEnd::REFUSED;
  closeRing();
  ring_.reset();
  bridged_ = false;
  started_ = false;
  if (!ended_)
  {
    BridgeClient::instance().want(shared_from_this(), refused ? ASK_AGAIN_REFUSED : ASK_AGAIN);
  }
}

void ReceiveLink::disconnect(bool deliver_rest)
{
  const std::shared_ptr<ReceiveLink> self = shared_from_this();  // the watchers may hold the last references
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  ended_ = true;
  if (deliver_rest)
  {
    drain(Drain::REST);
    if (bridged_ && in_use_ && socket_watched_)
    {
      active_.store(false, std::memory_order_release);
      return;  // messages under way between the devices follow; the bridge reports the end
    }
  }
  closeRing();
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
    if (taken == BATCH && extent == Drain::BATCH)
    {
      if (signalEvent(ring->doorbell(NETWORK_THREAD)))
      {
        return;  // the network thread returns after serving its other sockets
      }
    }
    Descriptor descriptor;
    uint32_t ticket = 0;
    const bool in_any_order = extent == Drain::REST || ended_ || started_;
    if (ring->ring().take(tcp_delivered_, in_any_order, &descriptor, &ticket) != RingConsumer::Take::TAKEN)
    {
      if (ring->ring().broken())
      {
        ROS_ERROR_ONCE("pi_os_transport: [%s] broke a shared ring: nothing more is received through it; restart it",
                       link->getCallerID().c_str());
      }
      return;
    }
    if (descriptor.segment == Descriptor::LINK_START)
    {
      started_ = true;
      tcp_before_start_ = descriptor.after_tcp;
      ring->release(ticket);
      continue;
    }
    const bool late = bridged_ && static_cast<int32_t>(tcp_delivered_ - tcp_before_start_) > 0;
    if (late || (bridged_ && !isNew(descriptor.after_tcp)))
    {
      late_ += late ? 1 : 0;
      ring->release(ticket);
      continue;
    }
    deliver(link, descriptor, ticket);
  }
}

void ReceiveLink::deliver(const ros::TransportPublisherLinkPtr& link, const Descriptor& descriptor, uint32_t ticket)
{
  boost::shared_array<uint8_t> buffer = fetch(ring_, descriptor, ticket, &copied_, held_);
  if (!buffer)
  {
    ROS_ERROR_ONCE("pi_os_transport: lost a message of %u bytes from [%s]: its shared memory cannot be read",
                   descriptor.length, link->getCallerID().c_str());
    return;
  }
  ++received_;
  latencies_.addSince(descriptor.stamp_ns);
  Runtime::instance().original.handle_message(link.get(), ros::SerializedMessage(buffer, descriptor.length), true,
                                              false);
}

boost::shared_array<uint8_t> ReceiveLink::fetch(const std::shared_ptr<RingReceiver>& ring, const Descriptor& descriptor,
                                                uint32_t ticket, uint64_t* copied,
                                                const std::shared_ptr<std::atomic<uint64_t>>& held)
{
  const std::shared_ptr<MappedSegment> segment = ring->find(descriptor);
  if (!segment)
  {
    ring->release(ticket);
    return boost::shared_array<uint8_t>();
  }
  if (segment->data() == nullptr)
  {
    ROS_WARN_ONCE(
        "pi_os_transport: cannot map %llu bytes of shared memory (%s); its messages are copied out instead. "
        "Raise the address space limit of this process (ulimit -v)",
        static_cast<unsigned long long>(segment->length()), std::strerror(ENOMEM));
  }
  else if (ring->leases() < MAX_LEASES &&
           (ring->leases() < 2 || ring->leasedBytes() + descriptor.length <= ring->leaseBudget()))
  {
    ring->lease(descriptor.length);
    return makeHoldable(const_cast<uint8_t*>(segment->data() + descriptor.offset),
                        Lease{ring, segment, ticket, descriptor.length}, held);
  }
  const boost::shared_array<uint8_t> copy = makeHoldable(
      new uint8_t[descriptor.length], [](uint8_t* bytes) { delete[] bytes; },
      held ? std::make_shared<std::atomic<uint64_t>>() : nullptr);
  const bool intact = segment->copy(descriptor.offset, copy.get(), descriptor.length);
  ring->release(ticket);
  ++*copied;
  return intact ? copy : boost::shared_array<uint8_t>();
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
