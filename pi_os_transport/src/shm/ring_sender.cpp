#include "shm/ring_sender.h"

#include <algorithm>
#include <cerrno>
#include <utility>

#include "shm/futex.h"
#include "shm/latency_histogram.h"
#include "shm/step_mark.h"

namespace pi_os_transport
{
namespace
{

/// TCPROS holds one partly written message in addition to its queue.
constexpr uint32_t WRITING_MESSAGES = 1;

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
  PI_OS_STEP("offer.sent");
  nonce_ = nonce;
  memory_ = std::move(mapping);
  ring_ = std::move(ring);
  messages_.assign(RingLayout::CAPACITY, Message{nullptr, 0, 0});
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
  messages_ = {};
  pair_.reset();
}

void RingSender::give(uint32_t ticket)
{
  if (const uint8_t* const buffer = std::exchange(messages_[ticket].buffer, nullptr))
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

bool RingSender::write(const Descriptor& descriptor, const uint8_t* buffer)
{
  uint32_t doorbell = 0;
  if (ring_->push(descriptor, &doorbell) == RingProducer::Push::FULL)
  {
    return false;
  }
  const size_t ticket = static_cast<size_t>(ring_->ticketOf(tail_));
  messages_[ticket] = Message{buffer, buffer != nullptr ? descriptor.length : 0, descriptor.after_tcp};
  ++tail_;
  PI_OS_STEP("send.buffer");
  if (doorbell == WAITING_THREAD)
  {
    futexWake(&reinterpret_cast<RingLayout*>(memory_.data())->armed);
    PI_OS_STEP("send.bell");
  }
  else if (doorbell != 0)
  {
    pair_->wake(link_, doorbell);
    PI_OS_STEP("send.bell");
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
  uint64_t in_flight_bytes = untakenBytes();
  while (max_queue > 0 && in_flight >= max_queue + WRITING_MESSAGES && in_flight_bytes + length > SOCKET_BYTES)
  {
    const int oldest = ring_->ticketOf(tail_ - in_flight);
    if (oldest >= 0 && messages_[static_cast<size_t>(oldest)].buffer == nullptr)
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
    in_flight_bytes -= std::min<uint64_t>(in_flight_bytes, messages_[static_cast<size_t>(dropped)].length);
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
             buffer))
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
               nullptr);
}

uint64_t RingSender::untakenBytes() const
{
  const uint32_t in_flight = untaken();
  uint64_t bytes = 0;
  for (uint32_t index = tail_ - std::min(in_flight, RingLayout::CAPACITY); index != tail_; ++index)
  {
    const int ticket = ring_->ticketOf(index);
    bytes += ticket >= 0 ? messages_[static_cast<size_t>(ticket)].length : 0;
  }
  return bytes;
}

std::vector<RingSender::Message> RingSender::takeBack()
{
  std::vector<Message> messages;
  for (int ticket = ring_ ? ring_->dropOldest() : -1; ticket >= 0; ticket = ring_->dropOldest())
  {
    Message& message = messages_[static_cast<size_t>(ticket)];
    if (message.buffer != nullptr)
    {
      messages.push_back(message);
      message.buffer = nullptr;
    }
  }
  return messages;
}

std::vector<RingSender::Message> RingSender::takeBackTaken()
{
  collect();
  std::vector<Message> messages;
  for (Message& message : messages_)
  {
    if (message.buffer != nullptr)
    {
      messages.push_back(message);
      message.buffer = nullptr;
    }
  }
  std::sort(messages.begin(), messages.end(), [](const Message& left, const Message& right)
            { return static_cast<int32_t>(left.after_tcp - right.after_tcp) < 0; });
  return messages;
}

}  // namespace pi_os_transport
