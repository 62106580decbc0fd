#include "transmit_link.h"

#include <ros/console.h>
#include <ros/publication.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace pi_os_transport
{
namespace
{

constexpr uint32_t LENGTH_PREFIX = 4;  // TCPROS puts the body's length in front of it, and so do publishers' buffers

/// What TCPROS holds beside its queue, and nodes that publish with a queue of one rely on: one message half written,
/// and what the sockets' buffers take on both sides.
constexpr uint32_t WRITING_MESSAGES = 1;
constexpr uint64_t SOCKET_BYTES = 1 << 20;

/// Buffers of the pool that may wait in an outbox of TCPROS before further ones are copied to the heap: a stuck TCPROS
/// peer must not exhaust the pool.
constexpr size_t MAX_POOLED_OUTBOX = 2;

}  // namespace

TransmitLink::~TransmitLink()
{
  closeChannel();
}

void TransmitLink::meet(SideChannel channel)
{
  std::string error;
  FileDescriptor memory = makeSharedMemory("pi_os_ring", sizeof(RingLayout), &error);
  std::array<FileDescriptor, DOORBELLS> doorbells;
  for (FileDescriptor& doorbell : doorbells)
  {
    doorbell = FileDescriptor(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  }
  SharedMapping mapping = memory ? SharedMapping(memory.get(), sizeof(RingLayout), true) : SharedMapping();
  if (!mapping || !doorbells.front() || !doorbells.back())
  {
    ROS_WARN("pi_os_transport: no shared memory for a subscriber of %s (%s); this link stays on TCPROS", topic_.c_str(),
             error.empty() ? std::strerror(errno) : error.c_str());
    return;
  }
  sealSharedMemory(memory.get(), false);

  Runtime& runtime = Runtime::instance();
  const uint64_t nonce = Token::random().high;
  auto ring = std::make_unique<RingProducer>(reinterpret_cast<RingLayout*>(mapping.data()), nonce);
  Packet offer;
  offer.type = Packet::OFFER;
  offer.values = {runtime.poolToken().high, runtime.poolToken().low, runtime.leaseBudget()};
  if (!channel.send(offer, {memory.get(), doorbells[0].get(), doorbells[1].get()}))
  {
    return;  // the subscriber has left again
  }
  std::lock_guard<std::mutex> lock(mutex_);
  nonce_ = nonce;
  memory_ = std::move(mapping);
  ring_ = std::move(ring);
  buffers_.resize(RingLayout::CAPACITY);
  lengths_.resize(RingLayout::CAPACITY);
  doorbells_ = std::move(doorbells);
  channel_ = std::move(channel);
  runtime.addChannel(shared_from_this());
  runtime.watch(channel_.fd(), [self = shared_from_this()](int) { self->onSocket(); });
}

void TransmitLink::onSocket()
{
  for (;;)
  {
    Packet packet;
    std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors;
    switch (channel_.receive(&packet, &descriptors))
    {
      case SideChannel::Receive::NOTHING:
        return;
      case SideChannel::Receive::CLOSED:
        onPeerGone();
        return;
      case SideChannel::Receive::MALFORMED:
        closeChannel();
        return;
      case SideChannel::Receive::PACKET:
        if (packet.type != Packet::PROOF || packet.values[0] != nonce_)
        {
          closeChannel();
          return;
        }
        std::lock_guard<std::mutex> lock(mutex_);
        setActive(!ended_);
        break;
    }
  }
}

void TransmitLink::onPeerGone()
{
  closeChannel();
  dropIfSilent(connection_.lock());
}

void TransmitLink::disconnect()
{
  Runtime::instance().forget(*this);
  std::lock_guard<std::mutex> lock(mutex_);
  ended_ = true;
  setActive(false);
}

void TransmitLink::closeChannel()
{
  Runtime& runtime = Runtime::instance();
  if (!runtime.active())
  {
    return;
  }
  // Kept alive to the end: the watcher and the set of channels may hold the last references. None exists when this is
  // called by the destructor, which then finds nothing left to do.
  const std::shared_ptr<TransmitLink> self = weak_from_this().lock();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    setActive(false);
    if (!channel_)
    {
      return;
    }
    runtime.unwatch(channel_.fd());
    channel_.close();
    doorbells_ = {};
    ring_->abandon([this, &runtime](uint32_t place) { runtime.pool().release(buffers_[place]); });
    ring_.reset();
    memory_.reset();
    buffers_ = {};
    lengths_ = {};
    announced_ = {};
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

void TransmitLink::collect()
{
  ring_->collect([this](uint32_t place) { Runtime::instance().pool().release(buffers_[place]); });
}

void TransmitLink::collectReleased()
{
  std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
  if (lock.owns_lock() && ring_)
  {
    collect();
  }
}

void TransmitLink::retire(const std::vector<uint32_t>& segments)
{
  std::lock_guard<std::mutex> lock(mutex_);
  for (uint32_t segment : segments)
  {
    const auto found = std::find(announced_.begin(), announced_.end(), segment);
    if (found != announced_.end())
    {
      announced_.erase(found);
      Packet packet;
      packet.type = Packet::RETIRED;
      packet.values[0] = segment;
      channel_.send(packet);  // one that does not come through costs the subscriber address space, nothing else
    }
  }
}

bool TransmitLink::announce(uint32_t segment)
{
  if (std::find(announced_.begin(), announced_.end(), segment) != announced_.end())
  {
    return true;
  }
  const SlotPool::Segment memory = Runtime::instance().pool().segment(segment);
  Packet packet;
  packet.type = Packet::SEGMENT;
  packet.values = {segment, memory.length, 0};
  if (!channel_.send(packet, {memory.fd}))
  {
    return false;
  }
  announced_.push_back(segment);
  return true;
}

bool TransmitLink::pushToRing(const uint8_t* buffer, uint32_t length, size_t max_queue, uint32_t after_tcp,
                              uint32_t* doorbell)
{
  SlotPool& pool = Runtime::instance().pool();
  collect();
  uint32_t in_flight = ring_->inFlight();
  if (in_flight > RingLayout::CAPACITY)
  {
    ROS_ERROR("pi_os_transport: a subscriber of %s broke the shared ring; the link goes back to TCPROS",
              topic_.c_str());
    setActive(false);
    return false;
  }
  uint64_t in_flight_bytes = 0;
  for (uint32_t index = tail_ - in_flight; index != tail_; ++index)
  {
    in_flight_bytes += lengths_[index % RingLayout::CAPACITY];
  }
  while (max_queue > 0 && in_flight >= max_queue + WRITING_MESSAGES && in_flight_bytes + length > SOCKET_BYTES)
  {
    const int place = ring_->dropOldest();
    if (place < 0)
    {
      break;  // the subscriber has just taken all of them
    }
    pool.release(buffers_[place]);
    in_flight_bytes -= std::min<uint64_t>(in_flight_bytes, lengths_[place]);
    in_flight = ring_->inFlight();
    ++dropped_;
  }
  if (in_flight > 1 && in_flight_bytes + length > Runtime::instance().leaseBudget())
  {
    return false;  // a stopped subscriber must not pin the pool; what follows waits in the outbox, on the heap
  }
  const SlotPool::Location location = pool.locate(buffer);
  if (!announce(location.segment))
  {
    return false;
  }
  const Descriptor descriptor{location.segment, length, location.offset + LENGTH_PREFIX, after_tcp};
  if (ring_->push(descriptor, doorbell) == RingProducer::Push::FULL)
  {
    return false;
  }
  buffers_[ring_->lastPlace()] = buffer;
  lengths_[ring_->lastPlace()] = length;
  ++tail_;
  ++sent_;
  return true;
}

void TransmitLink::pushToTcp(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message,
                             size_t max_queue)
{
  // As TransportSubscriberLink::enqueueMessage does it, with outbox_mutex_ held.
  if (max_queue > 0 && link->outbox_.size() >= max_queue)
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

void TransmitLink::enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message)
{
  Runtime& runtime = Runtime::instance();
  SlotPool& pool = runtime.pool();
  const uint8_t* buffer = nullptr;
  if (active() && message.num_bytes >= LENGTH_PREFIX && message.num_bytes - LENGTH_PREFIX >= runtime.options.min_bytes)
  {
    if (pool.contains(message.buf.get()))
    {
      buffer = message.buf.get();
      pool.addReference(buffer);
    }
    else if (uint8_t* copy = pool.allocate(message.num_bytes))
    {
      // Latched messages, those for a single subscriber, and those serialised when the pool was full.
      std::memcpy(copy, message.buf.get(), message.num_bytes);
      buffer = copy;
    }
  }

  size_t max_queue = 0;
  if (ros::PublicationPtr parent = link->parent_.lock())
  {
    max_queue = parent->getMaxQueue();
  }
  bool by_ring = false;
  uint32_t doorbell = 0;
  bool warn = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    boost::mutex::scoped_lock outbox_lock(link->outbox_mutex_);
    const bool outbox_empty = link->outbox_.empty();
    if (buffer != nullptr && active() && outbox_empty)
    {
      by_ring = pushToRing(buffer, static_cast<uint32_t>(message.num_bytes - LENGTH_PREFIX), max_queue,
                           tcp_pushed_ - tcp_dropped_, &doorbell);
    }
    if (!by_ring)
    {
      warn = buffer == nullptr && active() && message.num_bytes - LENGTH_PREFIX >= runtime.options.min_bytes &&
             !std::exchange(pool_warned_, true);
      if (link->outbox_.size() >= MAX_POOLED_OUTBOX && pool.contains(message.buf.get()))
      {
        ros::SerializedMessage copy;
        copy.num_bytes = message.num_bytes;
        copy.buf.reset(new uint8_t[message.num_bytes]);
        copy.message_start = copy.buf.get() + (message.message_start - message.buf.get());
        std::memcpy(copy.buf.get(), message.buf.get(), message.num_bytes);
        pushToTcp(link, copy, max_queue);
      }
      else
      {
        pushToTcp(link, message, max_queue);
      }
    }
    if (doorbell > 0 && doorbell <= DOORBELLS)
    {
      const uint64_t one = 1;
      while (write(doorbells_[doorbell - 1].get(), &one, sizeof(one)) < 0 && errno == EINTR)
      {
      }
    }
  }
  if (!by_ring)
  {
    if (buffer != nullptr)
    {
      pool.release(buffer);
    }
    link->startMessageWrite(false);
  }
  if (warn)
  {
    ROS_WARN(
        "pi_os_transport: no shared memory for a message of %zu bytes on %s: %s. Such messages to %s go over TCPROS; "
        "raise PI_OS_POOL_LIMIT_MB (now %llu) or the limits of this process",
        message.num_bytes, topic_.c_str(), pool.lastError().c_str(), link->getDestinationCallerID().c_str(),
        static_cast<unsigned long long>(runtime.options.pool_limit_mb));
  }
  link->stats_.messages_sent_++;
  link->stats_.bytes_sent_ += message.num_bytes;
  link->stats_.message_data_sent_ += message.num_bytes;
}

std::string TransmitLink::info()
{
  const SlotPool::Usage usage = Runtime::instance().pool().usage();
  std::lock_guard<std::mutex> lock(mutex_);
  return "SHMROS ring (" + std::to_string(sent_) + " messages through shared memory, " + std::to_string(dropped_) +
         " dropped, " + std::to_string(tcp_pushed_) + " through TCPROS; pool of the node " +
         std::to_string(usage.committed >> 10) + " of " + std::to_string(usage.limit >> 10) + " kiB)";
}

}  // namespace pi_os_transport
