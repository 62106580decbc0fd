#include "roscpp/topics/transmit_link.h"

#include <ros/console.h>
#include <ros/publication.h>

#include <algorithm>
#include <optional>
#include <queue>
#include <utility>

#include <nlohmann/json.hpp>

#include "roscpp/topics/numbered_message.h"
#include "roscpp/topics/outbox_writer.h"
#include "roscpp/topics/pooled_message.h"

namespace pi_os_transport
{
namespace
{

/// A bridge carries a new link within this time; then a link that must not use TCPROS says why it waits.
constexpr std::chrono::seconds BRIDGE_TIME{3};

size_t maxQueue(const ros::TransportSubscriberLink* link)
{
  const ros::PublicationPtr parent = link->parent_.lock();
  return parent ? parent->getMaxQueue() : 0;
}

bool isLatching(const ros::TransportSubscriberLink* link)
{
  const ros::PublicationPtr parent = link->parent_.lock();
  return parent && parent->isLatching();
}

}  // namespace

TransmitLink::~TransmitLink()
{
  closeRing();
}

void TransmitLink::meet(const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
{
  const bool bridge = hello.values[2] != 0;
  bool has_subscriber = false;
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    has_subscriber = ring_ && !(bridge && bridged_);
  }
  if (has_subscriber || !pair->addSender(hello.link, shared_from_this()))
  {
    pair->send(Packet::ended(hello.link, LinkEnd::REFUSED));
    return;
  }
  closeRing();  // that of a replaced bridge
  Runtime& runtime = Runtime::instance();
  auto ring = std::make_unique<RingSender>(&runtime.pool(), runtime.leaseBudget());
  std::string error;
  if (!ring->open(pair, hello.link, &error))
  {
    if (!error.empty())
    {
      fallback_ = Fallback::NO_MEMORY;
      runtime.warnOfShortage("no shared memory for a subscriber of " + topic_ + ": " + error);
    }
    pair->removeSender(hello.link, this);
    pair->send(Packet::ended(hello.link, LinkEnd::REFUSED));
    return;
  }
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  ring_ = std::move(ring);
  bridged_ = bridge;
  overflow_.forgetAnnouncement();
  runtime.addChannel(shared_from_this());
}

void TransmitLink::onPacket(const Packet& packet, SideChannel::Descriptors*)
{
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (!ring_ || packet.link != (ring_->link() | Packet::TO_SENDER))
    {
      return;  // about an earlier ring of this link
    }
    if (packet.type == Packet::SPACE && active())
    {
      overflow_.forgetAnnouncement();
      if (const ros::TransportSubscriberLinkPtr link = link_.lock())
      {
        overflow_.flush(ring_.get(), maxQueue(link.get()));
      }
      return;
    }
    if (ring_->isProof(packet))
    {
      bridged_ ? startBridged() : setActive(!ended_);
      return;
    }
  }
  if (packet.type == Packet::DECLINED)
  {
    onDeclined();
    return;
  }
  closeRing();
}

void TransmitLink::onDeclined()
{
  ros::TransportSubscriberLinkPtr to_write;
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    fallback_ = Fallback::NO_MEMORY;
    if (active())
    {
      to_write = link_.lock();
      returnToTcp();
      setActive(false);
    }
  }
  if (to_write)
  {
    to_write->startMessageWrite(false);
  }
}

void TransmitLink::onPairEnded()
{
  const bool bridged = bridged_;
  closeRing();
  if (!bridged)
  {
    dropIfSilent(connection_.lock());
  }
}

void TransmitLink::disconnect()
{
  Runtime::instance().forget(token_);
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  ended_ = true;
  setActive(false);
  overflow_.clear();
  if (bridged_ && ring_)
  {
    ring_->tell(Packet::ENDED, static_cast<uint64_t>(LinkEnd::CLOSED));
  }
}

void TransmitLink::closeRing()
{
  Runtime& runtime = Runtime::instance();
  if (!runtime.active())
  {
    return;
  }
  // Keeps this object alive: the pair and the set of channels may hold the last references. Null if called by the
  // destructor, when nothing is left to do.
  const std::shared_ptr<TransmitLink> self = weak_from_this().lock();
  ros::TransportSubscriberLinkPtr to_write;
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (!ring_)
    {
      setActive(false);
      return;
    }
    ring_->pair().removeSender(ring_->link(), this);
    ring_->tell(Packet::ENDED, static_cast<uint64_t>(ended_ ? LinkEnd::CLOSED : LinkEnd::BACK_TO_TCP));
    if (bridged_ && !ended_ && active())
    {
      to_write = link_.lock();
      returnToTcp();
    }
    setActive(false);
    ring_->collect();
    sent_before_ += ring_->sent();
    dropped_before_ += ring_->dropped();
    ring_.reset();
    bridged_ = false;
  }
  if (to_write)
  {
    to_write->startMessageWrite(false);
  }
  if (self)
  {
    runtime.removeChannel(self);
    runtime.announceRetired();
  }
}

void TransmitLink::setActive(bool active)
{
  if (active_.exchange(active, std::memory_order_acq_rel) != active)
  {
    Runtime::instance().active_transmit_links += active ? 1 : -1;
  }
}

void TransmitLink::pushToTcp(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message,
                             size_t max_queue)
{
  // Like TransportSubscriberLink::enqueueMessage, with outbox_mutex_ held. The queue is not what a bridge has left.
  returned_ = std::min(returned_, link->outbox_.size());
  if (max_queue > 0 && link->outbox_.size() - returned_ >= max_queue)
  {
    link->outbox_.pop();
    link->queue_full_ = true;
    ++tcp_dropped_;
  }
  else
  {
    link->queue_full_ = false;
  }
  link->outbox_.push(message);
  ++tcp_pushed_;
}

void TransmitLink::startBridged()
{
  const ros::TransportSubscriberLinkPtr link = link_.lock();
  if (!link || ended_ || active())
  {
    return;
  }
  const size_t max_queue = maxQueue(link.get());
  {
    // Messages that wait for TCPROS use the ring. The message being written is the last one over TCPROS.
    boost::mutex::scoped_lock outbox_lock(link->outbox_mutex_);
    for (; !link->outbox_.empty(); link->outbox_.pop())
    {
      ros::SerializedMessage message = link->outbox_.front();
      const std::optional<uint32_t> number = takeNumber(token_, LENGTH_PREFIX, &message);
      overflow_.push(message, 0, number ? *number : ++last_number_, 0, ring_.get());
      --tcp_pushed_;
    }
  }
  if (ring_->pushStart(max_queue, isLatching(link.get()), tcp_pushed_ - tcp_dropped_))
  {
    setActive(true);
    overflow_.flush(ring_.get(), max_queue);
  }
}

void TransmitLink::returnToTcp()
{
  const ros::TransportSubscriberLinkPtr link = link_.lock();
  if (!link)
  {
    return;
  }
  if (bridged_ && requires_bridge_)
  {
    keepForNextBridge();
  }
  else if (bridged_)
  {
    returnNumbered(link.get());
  }
  else
  {
    returnUntaken(link.get());
  }
}

/// Of a subscriber that takes no more from the ring.
void TransmitLink::returnUntaken(ros::TransportSubscriberLink* link)
{
  const size_t max_queue = maxQueue(link);
  boost::mutex::scoped_lock outbox_lock(link->outbox_mutex_);
  std::queue<ros::SerializedMessage> newer;  // found the ring full
  newer.swap(link->outbox_);
  for (const RingSender::Message& message : ring_->takeBack())
  {
    pushToTcp(link, pooledMessage(message), max_queue);
  }
  for (; !newer.empty(); newer.pop())
  {
    pushToTcp(link, newer.front(), max_queue);
    --tcp_pushed_;  // has been counted
  }
}

/// Of a bridge that has ended: the subscriber leaves out what it has.
void TransmitLink::returnNumbered(ros::TransportSubscriberLink* link)
{
  const auto push = [&](uint32_t number, const uint8_t* bytes, size_t length)
  { pushToTcp(link, numberedMessage(token_, number, bytes, length), 0); };
  const std::vector<RingSender::Message> untaken = ring_->takeBack();
  const std::vector<RingSender::Message> taken = ring_->takeBackTaken();
  boost::mutex::scoped_lock outbox_lock(link->outbox_mutex_);
  for (const std::vector<RingSender::Message>* messages : {&taken, &untaken})
  {
    for (const RingSender::Message& message : *messages)
    {
      push(message.after_tcp, message.buffer + LENGTH_PREFIX, message.length);
      Runtime::instance().pool().release(message.buffer);
    }
  }
  overflow_.takeAll([&](const ros::SerializedMessage& message, uint32_t number)
                    { push(number, message.buf.get() + LENGTH_PREFIX, message.num_bytes - LENGTH_PREFIX); });
  returned_ = link->outbox_.size();
}

/// The same on a link that must not use TCPROS.
void TransmitLink::keepForNextBridge()
{
  OverflowQueue later;
  later.takeOver(&overflow_);
  const std::vector<RingSender::Message> untaken = ring_->takeBack();
  const std::vector<RingSender::Message> taken = ring_->takeBackTaken();
  for (const std::vector<RingSender::Message>* messages : {&taken, &untaken})
  {
    for (const RingSender::Message& message : *messages)
    {
      overflow_.push(pooledMessage(message), 0, message.after_tcp, 0, nullptr);
    }
  }
  later.takeAll([&](const ros::SerializedMessage& message, uint32_t number)
                { overflow_.push(message, 0, number, 0, nullptr); });
}

/// Keeps a message for the bridge that is required. With mutex_ held.
void TransmitLink::hold(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, uint64_t serial,
                        size_t max_queue)
{
  dropped_before_ += overflow_.push(message, serial, ++last_number_, max_queue, nullptr) ? 1 : 0;
  if (std::chrono::steady_clock::now() - born_ > BRIDGE_TIME && !std::exchange(hold_warned_, true))
  {
    ROS_WARN(
        "pi_os_transport: %s waits for a bridge to %s, because PI_OS_REQUIRE_BRIDGE is set: start pi_os_bridge on "
        "both devices and look at its messages, or unset the variable here to send over TCPROS, unprotected",
        topic_.c_str(), link->getDestinationCallerID().c_str());
  }
}

void TransmitLink::warnOfPool(ros::TransportSubscriberLink* link, size_t bytes)
{
  Runtime& runtime = Runtime::instance();
  if (runtime.warnedOfShortage())
  {
    return;
  }
  runtime.warnOfShortage("no shared memory for a message of " + std::to_string(bytes) + " bytes on " + topic_ + " to " +
                         link->getDestinationCallerID() + ": " + runtime.pool().lastError() +
                         "; PI_OS_POOL_LIMIT_MB is " + std::to_string(runtime.options.pool_limit_mb));
}

/// Writes a message to the ring, or else puts it into the outbox for TCPROS. With mutex_ held.
/// @param pool_full  set if the message finds the pool full. @return true if it is in the ring
bool TransmitLink::pushOrQueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message,
                               uint64_t serial, size_t max_queue, bool* pool_full)
{
  Runtime& runtime = Runtime::instance();
  boost::mutex::scoped_lock outbox_lock(link->outbox_mutex_);
  const bool wanted = active() && link->outbox_.empty() && message.num_bytes >= LENGTH_PREFIX &&
                      message.num_bytes - LENGTH_PREFIX >= runtime.options.min_bytes;
  const uint8_t* const buffer = wanted ? poolBuffer(message) : nullptr;
  if (buffer != nullptr)
  {
    const RingSender::Push pushed = ring_->push(buffer, static_cast<uint32_t>(message.num_bytes - LENGTH_PREFIX),
                                                max_queue, tcp_pushed_ - tcp_dropped_, serial);
    if (pushed == RingSender::Push::WRITTEN)
    {
      return true;
    }
    if (pushed == RingSender::Push::BROKEN)
    {
      ROS_ERROR("pi_os_transport: a subscriber of %s broke the shared ring; the link goes back to TCPROS",
                topic_.c_str());
      setActive(false);
      fallback_ = Fallback::BROKEN;
    }
    runtime.pool().release(buffer);
  }
  else if (wanted)
  {
    ++pool_full_;
    *pool_full = true;
  }
  pushToTcp(link, messageToQueue(message, link->outbox_.size()), max_queue);
  return false;
}

void TransmitLink::enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message, uint64_t serial)
{
  const size_t max_queue = maxQueue(link);
  bool by_ring = false;
  bool warn = false;
  {
    std::unique_lock<std::recursive_mutex> lock(mutex_);
    if (active() && bridged_)
    {
      by_ring = true;
      dropped_before_ += overflow_.push(message, serial, ++last_number_, max_queue, ring_.get()) ? 1 : 0;
      if (!overflow_.flush(ring_.get(), max_queue))
      {
        lock.unlock();
        warnOfPool(link, message.num_bytes);
        closeRing();
      }
    }
    else if (requires_bridge_)
    {
      by_ring = true;
      hold(link, message, serial, max_queue);
    }
    else
    {
      by_ring = pushOrQueue(link, message, serial, max_queue, &warn);
    }
  }
  if (!by_ring && serial != 0)
  {
    OutboxWriter::add(link);
  }
  else if (!by_ring)
  {
    link->startMessageWrite(false);
  }
  if (warn)
  {
    warnOfPool(link, message.num_bytes);
  }
  link->stats_.messages_sent_++;
  link->stats_.bytes_sent_ += message.num_bytes;
  link->stats_.message_data_sent_ += message.num_bytes;
}

Fallback TransmitLink::describe(nlohmann::ordered_json* object)
{
  const ros::TransportSubscriberLinkPtr link = link_.lock();
  size_t outbox = 0;
  if (link)
  {
    boost::mutex::scoped_lock lock(link->outbox_mutex_);
    outbox = link->outbox_.size();
  }
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  object->update({{"memory", sent_before_ + (ring_ ? ring_->sent() : 0)},
                  {"tcp", tcp_pushed_},
                  {"dropped", dropped_before_ + (ring_ ? ring_->dropped() : 0) + tcp_dropped_},
                  {"waiting", (ring_ ? ring_->untaken() : 0) + overflow_.size() + outbox},
                  {"queue_size", link ? maxQueue(link.get()) : 0},
                  {"pool_full", pool_full_}});
  return active() ? Fallback::NONE : fallback_;
}

std::string TransmitLink::info()
{
  const SlotPool::Usage usage = Runtime::instance().pool().usage();
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  const uint64_t sent = sent_before_ + (ring_ ? ring_->sent() : 0);
  const uint64_t dropped = dropped_before_ + (ring_ ? ring_->dropped() : 0);
  return std::string(transportName()) + " ring (" + std::to_string(sent) + " messages through shared memory, " +
         std::to_string(dropped) + " dropped, " + std::to_string(tcp_pushed_) + " through TCPROS; pool of the node " +
         std::to_string(usage.committed >> 10) + " of " + std::to_string(usage.limit >> 10) + " kiB)";
}

}  // namespace pi_os_transport
