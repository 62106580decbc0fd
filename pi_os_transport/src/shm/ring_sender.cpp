#include "shm/ring_sender.h"

#include <algorithm>
#include <cerrno>
#include <utility>

#include "shm/futex.h"
#include "shm/latency_histogram.h"

namespace pi_os_transport
{
namespace
{

/// What TCPROS holds in addition to its queue: one partly written message, and the content of the socket buffers. Nodes
/// that publish with a queue of one rely on this.
constexpr uint32_t WRITING_MESSAGES = 1;
constexpr uint64_t SOCKET_BYTES = 1 << 20;

}  // namespace

bool RingSender::open(std::shared_ptr<ProcessPair> pair, uint32_t link, std::string* error)
{
  error->clear();
  FileDescriptor memory = makeSharedMemory("pi_os_ring", sizeof(RingLayout), error);
  SharedMapping mapping = memory ? SharedMapping(memory.get(), sizeof(RingLayout), true) : SharedMapping();
  if (!mapping)
  {
    *error = error->empty() ? describeFailure("mapping of shared memory", sizeof(RingLayout)) : *error;
    return false;
  }
  sealSharedMemory(memory.get(), false);

  const uint64_t nonce = Token::random().high;
  auto ring = std::make_unique<RingProducer>(reinterpret_cast<RingLayout*>(mapping.data()), nonce);
  if (!pair->send(Packet::of(Packet::OFFER, link, lease_budget_), std::move(memory)))
  {
    *error = errno == ETOOMANYREFS ? describeFailure("sending shared memory", sizeof(RingLayout)) : "";
    return false;
  }
  nonce_ = nonce;
  memory_ = std::move(mapping);
  ring_ = std::move(ring);
  buffers_.assign(RingLayout::CAPACITY, nullptr);
  lengths_.assign(RingLayout::CAPACITY, 0);
  pair_ = std::move(pair);
  link_ = link;
  tail_ = 0;
  return true;
}

void RingSender::close()
{
  if (!pair_)
  {
    return;
  }
  ring_->abandon([this](uint32_t ticket) { give(ticket); });
  ring_.reset();
  memory_.reset();
  buffers_ = {};
  lengths_ = {};
  pair_.reset();
}

void RingSender::give(uint32_t ticket)
{
  if (const uint8_t* const buffer = std::exchange(buffers_[ticket], nullptr))
  {
    pool_->release(buffer);
  }
}

void RingSender::collect()
{
  if (ring_)
  {
    ring_->collect([this](uint32_t ticket) { give(ticket); });
  }
}

bool RingSender::write(const Descriptor& descriptor, const uint8_t* buffer, uint32_t length)
{
  uint32_t doorbell = 0;
  if (ring_->push(descriptor, &doorbell) == RingProducer::Push::FULL)
  {
    return false;
  }
  const size_t ticket = static_cast<size_t>(ring_->ticketOf(tail_));
  buffers_[ticket] = buffer;
  lengths_[ticket] = length;
  ++tail_;
  if (doorbell == WAITING_THREAD)
  {
    futexWake(&reinterpret_cast<RingLayout*>(memory_.data())->armed);
  }
  else if (doorbell != 0)
  {
    pair_->wake(link_, doorbell);
  }
  return true;
}

RingSender::Push RingSender::push(const uint8_t* buffer, uint32_t length, size_t max_queue, uint32_t after_tcp,
                                  uint64_t serial)
{
  collect();
  uint32_t in_flight = ring_->inFlight();
  if (in_flight > RingLayout::CAPACITY)
  {
    return Push::BROKEN;
  }
  uint64_t in_flight_bytes = 0;
  for (uint32_t index = tail_ - in_flight; index != tail_; ++index)
  {
    const int ticket = ring_->ticketOf(index);
    in_flight_bytes += ticket >= 0 ? lengths_[static_cast<size_t>(ticket)] : 0;
  }
  while (max_queue > 0 && in_flight >= max_queue + WRITING_MESSAGES && in_flight_bytes + length > SOCKET_BYTES)
  {
    const int oldest = ring_->ticketOf(tail_ - in_flight);
    if (oldest >= 0 && buffers_[static_cast<size_t>(oldest)] == nullptr)
    {
      return Push::FULL;  // the start of the link must not be dropped
    }
    const int dropped = ring_->dropOldest();
    if (dropped < 0)
    {
      if (ring_->inFlight() != 0)
      {
        return Push::BROKEN;
      }
      break;  // the subscriber has taken all of them meanwhile
    }
    give(static_cast<uint32_t>(dropped));
    in_flight_bytes -= std::min<uint64_t>(in_flight_bytes, lengths_[static_cast<size_t>(dropped)]);
    in_flight = ring_->inFlight();
    ++dropped_;
  }
  if (in_flight > 1 && in_flight_bytes + length > lease_budget_)
  {
    return Push::FULL;  // a stopped subscriber must not pin the pool
  }
  const SlotPool::Location location = pool_->locate(buffer);
  if (!pair_->announce(*pool_, location.segment) ||
      !write(Descriptor{location.segment, length, location.offset + LENGTH_PREFIX, after_tcp, serial, monotonicNs()},
             buffer, length))
  {
    return Push::FULL;
  }
  ++sent_;
  return Push::WRITTEN;
}

bool RingSender::pushStart(size_t max_queue, bool latched, uint32_t after_tcp)
{
  return write(Descriptor{Descriptor::LINK_START, static_cast<uint32_t>(max_queue), 0, after_tcp, latched ? 1u : 0u,
                          monotonicNs()},
               nullptr, 0);
}

std::vector<RingSender::Message> RingSender::takeBack()
{
  std::vector<Message> messages;
  for (int ticket = ring_ ? ring_->dropOldest() : -1; ticket >= 0; ticket = ring_->dropOldest())
  {
    const size_t index = static_cast<size_t>(ticket);
    if (buffers_[index] != nullptr)
    {
      messages.push_back(Message{std::exchange(buffers_[index], nullptr), lengths_[index]});
    }
  }
  return messages;
}

RingSender::Message RingSender::takeBackNewest()
{
  collect();
  const int newest = ring_ && ring_->inFlight() == 0 ? ring_->ticketOf(tail_ - 1) : -1;
  if (newest < 0)
  {
    return Message{nullptr, 0};
  }
  const size_t ticket = static_cast<size_t>(newest);
  return Message{std::exchange(buffers_[ticket], nullptr), lengths_[ticket]};
}

}  // namespace pi_os_transport
