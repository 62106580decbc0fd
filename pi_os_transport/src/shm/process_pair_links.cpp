// What the links of a ProcessPair use of it: numbers, sending, segments, waking.

#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "shm/futex.h"
#include "shm/process_pair.h"

namespace pi_os_transport
{
namespace
{

/// Packets that wait for a peer that reads nothing. An honest one causes no more than a few for each link.
constexpr size_t MAX_UNSENT = size_t{8} * NewsLayout::LINKS;

}  // namespace

uint32_t ProcessPair::addReceiver(const std::shared_ptr<PairLink>& link)
{
  constexpr uint32_t GENERATIONS = Packet::TO_SENDER / NewsLayout::LINKS;
  const std::lock_guard<std::mutex> lock(mutex_);
  for (uint32_t tried = 0; tried < NewsLayout::LINKS && !ended_; ++tried)
  {
    const uint32_t place = next_place_++ % NewsLayout::LINKS;
    if (numbers_[place] == 0)
    {
      generation_ = generation_ % (GENERATIONS - 1) + 1;
      const uint32_t number = generation_ * NewsLayout::LINKS + place;
      numbers_[place] = number;
      receivers_[number] = link;
      return number;
    }
  }
  return 0;
}

void ProcessPair::removeReceiver(uint32_t number)
{
  std::shared_ptr<PairLink> removed;  // is destroyed without the lock
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = receivers_.find(number);
  if (found != receivers_.end())
  {
    removed = std::move(found->second);
    receivers_.erase(found);
  }
}

void ProcessPair::leave(uint32_t number)
{
  removeReceiver(number);
  send(Packet::ended(number | Packet::TO_SENDER, LinkEnd::CLOSED));
  const std::lock_guard<std::mutex> lock(mutex_);
  uint32_t& place = numbers_[number % NewsLayout::LINKS];
  place = place == number ? 0 : place;
}

bool ProcessPair::addSender(uint32_t number, const std::shared_ptr<PairLink>& link)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return !ended_ && senders_.size() < NewsLayout::LINKS && senders_.emplace(number, link).second;
}

void ProcessPair::removeSender(uint32_t number, const PairLink* link)
{
  std::shared_ptr<PairLink> removed;
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = senders_.find(number);
  if (found != senders_.end() && found->second.get() == link)
  {
    removed = std::move(found->second);
    senders_.erase(found);
  }
}

bool ProcessPair::send(const Packet& packet, FileDescriptor descriptor)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return sendLocked(&packet, sizeof(packet), std::move(descriptor));
}

bool ProcessPair::sendBytes(const std::vector<uint8_t>& bytes)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return bytes.size() <= LONGEST_PACKET && sendLocked(bytes.data(), bytes.size(), FileDescriptor());
}

bool ProcessPair::sendLocked(const void* bytes, size_t length, FileDescriptor descriptor)
{
  if (!channel_)
  {
    errno = EPIPE;
    return false;
  }
  errno = EAGAIN;
  const bool sent = unsent_.empty() && (descriptor ? channel_.sendBytes(bytes, length, {descriptor.get()})
                                                   : channel_.sendBytes(bytes, length));
  if (!sent && errno == EAGAIN && unsent_.size() == MAX_UNSENT)
  {
    shutdown(channel_.fd(), SHUT_RDWR);  // the network thread then finds the pair ended
    errno = EPIPE;
    return false;
  }
  if (!sent && errno == EAGAIN)
  {
    const auto* const first = static_cast<const uint8_t*>(bytes);
    unsent_.push_back(Unsent{std::vector<uint8_t>(first, first + length), std::move(descriptor)});
    if (unsent_.size() == 1)
    {
      host_->want_write(this, true);
    }
    return true;
  }
  return sent;
}

void ProcessPair::flush()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  for (; !unsent_.empty(); unsent_.pop_front())
  {
    const Unsent& next = unsent_.front();
    const bool sent = next.descriptor
                          ? channel_.sendBytes(next.bytes.data(), next.bytes.size(), {next.descriptor.get()})
                          : channel_.sendBytes(next.bytes.data(), next.bytes.size());
    if (!sent && errno == EAGAIN)
    {
      return;
    }
  }
  host_->want_write(this, false);
}

bool ProcessPair::announce(const SlotPool& pool, uint32_t segment)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto position = std::lower_bound(announced_.begin(), announced_.end(), segment);
  if (position != announced_.end() && *position == segment)
  {
    return true;
  }
  const SlotPool::Segment memory = pool.segment(segment);
  if (!channel_ || !unsent_.empty() ||
      !channel_.send(Packet::of(Packet::SEGMENT, 0, segment, memory.length), {memory.fd}))
  {
    return false;
  }
  announced_.insert(position, segment);
  return true;
}

void ProcessPair::retire(const std::vector<uint32_t>& segments)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const uint32_t segment : segments)
  {
    const auto position = std::lower_bound(announced_.begin(), announced_.end(), segment);
    if (position != announced_.end() && *position == segment)
    {
      announced_.erase(position);
      const Packet packet = Packet::of(Packet::RETIRED, 0, segment);
      sendLocked(&packet, sizeof(packet), FileDescriptor());
    }
  }
}

void ProcessPair::wake(uint32_t number, uint32_t doorbell)
{
  if (!NewsBoard(peer_news_).add(number % NewsLayout::LINKS))
  {
    return;
  }
  const uint32_t spinner = doorbell - FIRST_SPINNER;
  if (doorbell >= FIRST_SPINNER && spinner < WakeLayout::SLEEPERS && peer_wake_ != nullptr)
  {
    if (std::atomic<uint32_t>* const word = Sleeper(&peer_wake_->sleepers[spinner]).ring())
    {
      futexWake(word);
      return;
    }
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (channel_)
  {
    channel_.send(Packet::of(Packet::BELL, 0));  // if its queue is full, the peer's network thread will look anyway
  }
}

ProcessPair::Lookup ProcessPair::findSegment(uint32_t segment, uint32_t number, std::shared_ptr<MappedSegment>* found)
{
  for (bool pulled = false;; pulled = true)
  {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const auto known = segments_.find(segment);
      if (known != segments_.end())
      {
        *found = known->second;
        return known->second ? Lookup::FOUND : Lookup::LOST;
      }
      if (pulled)
      {
        if (std::find(awaiting_.begin(), awaiting_.end(), number) == awaiting_.end())
        {
          awaiting_.push_back(number);
        }
        return Lookup::UNKNOWN;
      }
    }
    if (pull())
    {
      host_->receive_soon(shared_from_this());
    }
  }
}

}  // namespace pi_os_transport
