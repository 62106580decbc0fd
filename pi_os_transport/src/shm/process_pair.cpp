#include "shm/process_pair.h"

#include <algorithm>
#include <cerrno>
#include <utility>

namespace pi_os_transport
{
namespace
{

/// Packets read before other sockets have their turn.
constexpr size_t BATCH = 256;

template <typename Layout>
Layout* mapLayout(int fd, SharedMapping* mapping)
{
  *mapping = isSealed(fd, sizeof(Layout)) ? SharedMapping(fd, sizeof(Layout), true) : SharedMapping();
  auto* const layout = reinterpret_cast<Layout*>(mapping->data());
  return layout != nullptr && layout->magic == Layout::MAGIC ? layout : nullptr;
}

}  // namespace

std::shared_ptr<ProcessPair> ProcessPair::make(SideChannel channel, std::shared_ptr<const Host> host,
                                               std::string* shortage)
{
  const std::shared_ptr<ProcessPair> pair(new ProcessPair(std::move(channel), std::move(host)));
  return pair->introduce(shortage) ? pair : nullptr;
}

bool ProcessPair::introduce(std::string* shortage)
{
  shortage->clear();
  numbers_.assign(NewsLayout::LINKS, 0);
  const FileDescriptor memory = makeSharedMemory("pi_os_news", sizeof(NewsLayout), shortage);
  own_news_memory_ = memory ? SharedMapping(memory.get(), sizeof(NewsLayout), true) : SharedMapping();
  if (!own_news_memory_)
  {
    *shortage = shortage->empty() ? describeFailure("mapping of shared memory", sizeof(NewsLayout)) : *shortage;
    return false;
  }
  own_news_ = reinterpret_cast<NewsLayout*>(own_news_memory_.data());
  own_news_->magic = NewsLayout::MAGIC;
  sealSharedMemory(memory.get(), false);
  const Packet meet = Packet::of(Packet::MEET, 0, host_->token.high, host_->token.low);
  const bool sent = host_->wake_memory >= 0 ? channel_.send(meet, {memory.get(), host_->wake_memory})
                                            : channel_.send(meet, {memory.get()});
  if (!sent && errno == ETOOMANYREFS)
  {
    *shortage = describeFailure("sending shared memory", sizeof(NewsLayout));
  }
  return sent;
}

bool ProcessPair::receive()
{
  pull();
  for (;;)
  {
    Received next;
    {
      const std::lock_guard<std::mutex> lock(receive_mutex_);
      if (received_.empty())
      {
        break;
      }
      next = std::move(received_.front());
      received_.pop_front();
    }
    if (!handle(&next))
    {
      return false;
    }
  }
  serveNews();
  const std::lock_guard<std::mutex> lock(receive_mutex_);
  return !closed_;
}

/// Reads what has come. What concerns the memory is done here, the rest by receive(). @return true if there is a rest
bool ProcessPair::pull()
{
  const std::lock_guard<std::mutex> lock(receive_mutex_);
  for (size_t count = 0; count < BATCH && !closed_ && channel_; ++count)
  {
    Received next;
    const SideChannel::Receive result = channel_.receiveBytes(&next.request, LONGEST_PACKET, &next.descriptors);
    if (result == SideChannel::Receive::NOTHING)
    {
      break;
    }
    next.shortage = result == SideChannel::Receive::NO_DESCRIPTORS;
    closed_ = (result != SideChannel::Receive::PACKET && !next.shortage) || !sort(&next);
  }
  return closed_ || !received_.empty();
}

/// @return false if the packet is not acceptable.
bool ProcessPair::sort(Received* received)
{
  Packet& packet = received->packet;
  if (received->request.size() == sizeof(packet))
  {
    std::copy(received->request.begin(), received->request.end(), reinterpret_cast<uint8_t*>(&packet));
  }
  const bool is_packet = received->request.size() == sizeof(packet) && packet.version == PROTOCOL_VERSION;
  if (is_packet && received->shortage)
  {
    host_->on_shortage(describeShortage(EMFILE));
  }
  if (peer_news_ == nullptr)
  {
    return is_packet && packet.type == Packet::MEET && meet(received);
  }
  if (is_packet && (packet.type == Packet::SEGMENT || packet.type == Packet::RETIRED))
  {
    onSegment(received);
    return true;
  }
  if (is_packet)
  {
    received->request.clear();
  }
  else if (!host_->on_request)
  {
    return false;
  }
  received_.push_back(std::move(*received));
  return true;
}

bool ProcessPair::meet(Received* received)
{
  peer_wake_ = mapLayout<WakeLayout>(received->descriptors[1].get(), &peer_wake_memory_);
  peer_news_ = mapLayout<NewsLayout>(received->descriptors[0].get(), &peer_news_memory_);
  peer_token_ = Token{received->packet.values[0], received->packet.values[1]};
  if (peer_news_ != nullptr)
  {
    met_.store(true, std::memory_order_release);
    received_.push_back(std::move(*received));
    received_.back().request.clear();
  }
  return peer_news_ != nullptr;
}

void ProcessPair::onSegment(Received* received)
{
  const uint32_t id = static_cast<uint32_t>(received->packet.values[0]);
  const uint64_t length = received->packet.values[1];
  FileDescriptor& memory = received->descriptors[0];
  const bool valid = received->packet.type == Packet::SEGMENT && isSealed(memory.get(), length);
  std::shared_ptr<MappedSegment> segment = valid ? std::make_shared<MappedSegment>(std::move(memory), length) : nullptr;
  std::vector<uint32_t> served;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (received->packet.type == Packet::RETIRED)
    {
      segments_.erase(id);
      return;
    }
    segments_[id] = std::move(segment);
    served.swap(awaiting_);
  }
  for (const uint32_t number : served)
  {
    NewsBoard(own_news_).add(number % NewsLayout::LINKS);
  }
}

bool ProcessPair::handle(Received* received)
{
  const Packet& packet = received->packet;
  if (!received->request.empty())
  {
    return host_->on_request(shared_from_this(), received->request);
  }
  switch (packet.type)
  {
    case Packet::MEET:
      if (host_->on_met)
      {
        host_->on_met(shared_from_this());
      }
      return true;
    case Packet::BELL:
      return true;
    case Packet::HELLO:
      if (!host_->on_hello(shared_from_this(), packet))
      {
        send(Packet::ended(packet.link, LinkEnd::REFUSED));
      }
      return true;
    default:
      if (const std::shared_ptr<PairLink> link = findLink(packet.link))
      {
        link->onPacket(packet, &received->descriptors);
      }
      return true;
  }
}

std::shared_ptr<PairLink> ProcessPair::findLink(uint32_t addressed) const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto& links = (addressed & Packet::TO_SENDER) != 0 ? senders_ : receivers_;
  const auto found = links.find(addressed & ~Packet::TO_SENDER);
  return found != links.end() ? found->second : nullptr;
}

void ProcessPair::serveNews()
{
  NewsBoard(own_news_).take([this](uint32_t place) { serve(place); });
}

void ProcessPair::serve(uint32_t place)
{
  uint32_t number = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    number = numbers_[place];
  }
  if (const std::shared_ptr<PairLink> link = number != 0 ? findLink(number) : nullptr)
  {
    link->serve();
  }
}

void ProcessPair::end()
{
  std::map<uint32_t, std::shared_ptr<PairLink>> receivers;
  std::map<uint32_t, std::shared_ptr<PairLink>> senders;
  {
    const std::lock_guard<std::mutex> receive_lock(receive_mutex_);
    const std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
    ended_.store(true, std::memory_order_release);
    channel_.close();
    unsent_.clear();
    receivers.swap(receivers_);
    senders.swap(senders_);
  }
  for (const auto* links : {&receivers, &senders})
  {
    for (const auto& link : *links)
    {
      link.second->onPairEnded();
    }
  }
}

}  // namespace pi_os_transport
