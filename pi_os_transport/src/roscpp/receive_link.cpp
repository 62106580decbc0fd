#include "receive_link.h"

#include <ros/console.h>
#include <ros/subscription.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <sstream>
#include <utility>

#include "queue_waiter.h"

namespace pi_os_transport
{
namespace
{

/// With more messages leased than this, further ones are copied: a place in the ring is free again only when its
/// message is released.
constexpr uint32_t MAX_LEASES = RingLayout::CAPACITY / 2;
/// Messages handed on before the network thread looks at its other sockets again.
constexpr int BATCH = 64;

/// The mapped segments of this process by pool and id, so that several links to one publisher map its memory once.
class SegmentTable
{
public:
  static SegmentTable& instance()
  {
    static SegmentTable* table = new SegmentTable;  // leases may outlive static destruction
    return *table;
  }

  std::shared_ptr<MappedSegment> map(const Token& pool, uint32_t id, FileDescriptor memory, uint64_t length)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    for (auto entry = segments_.begin(); entry != segments_.end();)
    {
      entry = entry->second.expired() ? segments_.erase(entry) : std::next(entry);
    }
    std::weak_ptr<MappedSegment>& known = segments_[std::make_pair(pool, id)];
    std::shared_ptr<MappedSegment> segment = known.lock();
    if (!segment)
    {
      segment = std::make_shared<MappedSegment>(std::move(memory), length);
      known = segment;
    }
    return segment;
  }

private:
  std::mutex mutex_;
  std::map<std::pair<Token, uint32_t>, std::weak_ptr<MappedSegment>> segments_;
};

}  // namespace

MappedSegment::MappedSegment(FileDescriptor memory, uint64_t length)
  : mapping_(memory.get(), length, false), length_(length)
{
  if (!mapping_)
  {
    ROS_WARN_ONCE(
        "pi_os_transport: cannot map %llu bytes of shared memory (%s); its messages are copied out instead. "
        "Raise the address space limit of this process (ulimit -v)",
        static_cast<unsigned long long>(length), std::strerror(errno));
    memory_ = std::move(memory);
  }
}

bool MappedSegment::copy(uint64_t offset, uint8_t* out, uint32_t bytes) const
{
  if (mapping_)
  {
    std::memcpy(out, mapping_.data() + offset, bytes);
    return true;
  }
  for (uint32_t done = 0; done < bytes;)
  {
    const ssize_t count = pread(memory_.get(), out + done, bytes - done, static_cast<off_t>(offset + done));
    if (count <= 0 && errno != EINTR)
    {
      return false;
    }
    done += count > 0 ? static_cast<uint32_t>(count) : 0;
  }
  return true;
}

/// Deleter of a leased buffer: gives the place back to the publisher.
struct ReceiveLink::Lease
{
  std::shared_ptr<ReceiveLink> link;
  uint32_t place;
  uint32_t length;

  void operator()(uint8_t*) const
  {
    if (Runtime::instance().active())
    {
      link->leased_bytes_ -= length;
      --link->leases_;
      link->ring_->release(place);
    }
  }
};

void ReceiveLink::meet(const std::string& header_field)
{
  std::istringstream fields(header_field);
  uint32_t version = 0;
  std::string socket_token;
  std::string link_token;
  fields >> version >> socket_token >> link_token;
  const std::optional<Token> token = Token::fromString(link_token);
  if (version != PROTOCOL_VERSION || !Token::fromString(socket_token) || !token)
  {
    return;
  }
  SideChannel channel = SideChannel::connect("pi_os/" + socket_token);
  Packet hello;
  hello.type = Packet::HELLO;
  hello.values = {token->high, token->low, 0};
  if (!channel || !channel.send(hello))
  {
    return;  // another device, container or user
  }
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  channel_ = std::move(channel);
  socket_watched_ = true;
  Runtime::instance().watch(channel_.fd(), [self = shared_from_this()](int) { self->onSocket(); });
}

void ReceiveLink::onSocket()
{
  {
    std::lock_guard<std::recursive_mutex> lock(mutex_);
    if (!socket_watched_)
    {
      return;
    }
    const SideChannel::Receive end = readPackets();
    if (end == SideChannel::Receive::NOTHING)
    {
      return;
    }
    unwatchSocket();
    if (end == SideChannel::Receive::MALFORMED && !active())
    {
      return;  // without a proof from here the link stays on TCPROS
    }
    drain(Drain::ALL_DUE);
  }
  dropIfSilent(connection_.lock());
}

SideChannel::Receive ReceiveLink::readPackets()
{
  for (;;)
  {
    Packet packet;
    std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors;
    const SideChannel::Receive result = channel_.receive(&packet, &descriptors);
    if (result != SideChannel::Receive::PACKET)
    {
      return result;
    }
    if (packet.type == Packet::OFFER && ring_ == nullptr)
    {
      onOffer(packet, std::move(descriptors));
    }
    else if (packet.type == Packet::SEGMENT && isSealed(descriptors[0].get(), packet.values[1]))
    {
      const uint32_t id = static_cast<uint32_t>(packet.values[0]);
      segments_[id] = SegmentTable::instance().map(pool_, id, std::move(descriptors[0]), packet.values[1]);
    }
    else if (packet.type == Packet::RETIRED)
    {
      segments_.erase(static_cast<uint32_t>(packet.values[0]));
    }
  }
}

void ReceiveLink::onOffer(const Packet& packet, std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors)
{
  const FileDescriptor& memory = descriptors[0];
  if (!isSealed(memory.get(), sizeof(RingLayout)) || !descriptors[1] || !descriptors[2])
  {
    return;
  }
  memory_ = SharedMapping(memory.get(), sizeof(RingLayout), true);
  auto* const layout = reinterpret_cast<RingLayout*>(memory_.data());
  if (layout == nullptr || layout->magic != RingLayout::MAGIC)
  {
    return;  // no proof is sent, so the publisher goes on with TCPROS
  }
  ring_ = std::make_unique<RingConsumer>(layout);
  pool_ = Token{packet.values[0], packet.values[1]};
  lease_budget_ = packet.values[2];
  doorbells_ = {std::move(descriptors[1]), std::move(descriptors[2])};
  Runtime::instance().watch(doorbells_[0].get(), [self = shared_from_this()](int) { self->onDoorbell(); });
  drain(Drain::BATCH);  // arms the doorbell before the first message can be written
  joinWaiter();
  Packet proof;
  proof.type = Packet::PROOF;
  proof.values[0] = layout->nonce;
  active_.store(channel_.send(proof), std::memory_order_release);
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
  // With several queues the others are served as well, but only while a thread waits on the first.
  if (auto* queue = dynamic_cast<ros::CallbackQueue*>(subscription->callbacks_.front()->callback_queue_))
  {
    waiter_ = QueueWaiter::of(queue);
    waiter_->add(shared_from_this(), doorbells_[SPINNER - 1].get());
  }
}

void ReceiveLink::serve(Doorbell doorbell)
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (ring_)
  {
    ring_->useDoorbell(doorbell);
    drain(Drain::BATCH);
  }
}

void ReceiveLink::onDoorbell()
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  uint64_t rings;
  if (doorbells_[0] && read(doorbells_[0].get(), &rings, sizeof(rings)) == static_cast<ssize_t>(sizeof(rings)))
  {
    drain(Drain::BATCH);
  }
}

void ReceiveLink::unwatchSocket()
{
  if (std::exchange(socket_watched_, false))
  {
    Runtime::instance().unwatch(channel_.fd());
  }
}

void ReceiveLink::disconnect(bool deliver_rest)
{
  const std::shared_ptr<ReceiveLink> self = shared_from_this();  // the watchers may hold the last references
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (deliver_rest)
  {
    drain(Drain::REST);
  }
  unwatchSocket();
  if (doorbells_[0])
  {
    Runtime::instance().unwatch(doorbells_[0].get());
  }
  if (const std::shared_ptr<QueueWaiter> waiter = std::exchange(waiter_, nullptr))
  {
    waiter->remove(self, doorbells_[SPINNER - 1].get());
  }
  doorbells_ = {};
  active_.store(false, std::memory_order_release);
}

void ReceiveLink::drain(Drain extent)
{
  if (!ring_ || !doorbells_[0])
  {
    return;
  }
  const ros::TransportPublisherLinkPtr link = link_.lock();
  if (!link)
  {
    return;
  }
  // doorbells_ are empty once a callback run in place has ended the link.
  for (int taken = 0; doorbells_[0]; ++taken)
  {
    if (taken == BATCH && extent == Drain::BATCH)
    {
      const uint64_t one = 1;  // come back after a look at the other sockets
      if (write(doorbells_[0].get(), &one, sizeof(one)) == static_cast<ssize_t>(sizeof(one)))
      {
        return;
      }
    }
    Descriptor descriptor;
    uint32_t place = 0;
    if (ring_->take(tcp_delivered_, extent == Drain::REST, &descriptor, &place) != RingConsumer::Take::TAKEN)
    {
      return;
    }
    deliver(link, descriptor, place);
  }
}

void ReceiveLink::deliver(const ros::TransportPublisherLinkPtr& link, const Descriptor& descriptor, uint32_t place)
{
  boost::shared_array<uint8_t> buffer = fetch(descriptor, place);
  if (!buffer)
  {
    ROS_ERROR_ONCE("pi_os_transport: lost a message of %u bytes from [%s]: its shared memory cannot be read",
                   descriptor.length, link->getCallerID().c_str());
    return;
  }
  ++received_;
  Runtime::instance().original.handle_message(link.get(), ros::SerializedMessage(buffer, descriptor.length), true,
                                              false);
}

boost::shared_array<uint8_t> ReceiveLink::fetch(const Descriptor& descriptor, uint32_t place)
{
  auto found = segments_.find(descriptor.segment);
  if (found == segments_.end())
  {
    readPackets();  // a segment's memory is always sent before the first message in it
    found = segments_.find(descriptor.segment);
  }
  if (found == segments_.end() || descriptor.offset + descriptor.length > found->second->length())
  {
    ring_->release(place);
    return boost::shared_array<uint8_t>();
  }
  const MappedSegment& segment = *found->second;
  const uint32_t leases = leases_.load(std::memory_order_relaxed);
  const uint64_t leased = leased_bytes_.load(std::memory_order_relaxed);
  if (segment.data() != nullptr && leases < MAX_LEASES && (leases < 2 || leased + descriptor.length <= lease_budget_))
  {
    leased_bytes_ += descriptor.length;
    ++leases_;
    return boost::shared_array<uint8_t>(const_cast<uint8_t*>(segment.data() + descriptor.offset),
                                        Lease{shared_from_this(), place, descriptor.length});
  }
  ++copied_;
  boost::shared_array<uint8_t> copy(new uint8_t[descriptor.length]);
  const bool read = segment.copy(descriptor.offset, copy.get(), descriptor.length);
  ring_->release(place);
  return read ? copy : boost::shared_array<uint8_t>();
}

std::string ReceiveLink::info()
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  return "SHMROS ring (" + std::to_string(received_) + " messages through shared memory, " + std::to_string(copied_) +
         " of them copied for want of leases, " + std::to_string(tcp_delivered_) + " through TCPROS)";
}

}  // namespace pi_os_transport
