#include "shm/ring_sender.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "shm/event.h"
#include "shm/latency_histogram.h"
#include "shm/step_mark.h"

namespace pi_os_transport
{
namespace
{

/// What TCPROS holds in addition to its queue: one partly written message, and the content of the socket buffers. Nodes
/// that publish with a queue of one rely on this.
constexpr uint32_t WRITING_MESSAGES = 1;
constexpr uint64_t SOCKET_BYTES = 1 << 20;

}  // namespace

bool RingSender::open(SideChannel channel, std::string* error)
{
  error->clear();
  FileDescriptor memory = makeSharedMemory("pi_os_ring", sizeof(RingLayout), error);
  std::array<FileDescriptor, DOORBELLS> doorbells;
  for (FileDescriptor& doorbell : doorbells)
  {
    doorbell = makeEvent();
  }
  SharedMapping mapping = memory ? SharedMapping(memory.get(), sizeof(RingLayout), true) : SharedMapping();
  if (!mapping || !doorbells.front() || !doorbells.back())
  {
    *error = error->empty() ? std::strerror(errno) : *error;
    return false;
  }
  sealSharedMemory(memory.get(), false);

  const uint64_t nonce = Token::random().high;
  auto ring = std::make_unique<RingProducer>(reinterpret_cast<RingLayout*>(mapping.data()), nonce);
  const Packet offer = Packet::of(Packet::OFFER, pool_token_.high, pool_token_.low, lease_budget_);
  if (!channel.send(offer, {memory.get(), doorbells[0].get(), doorbells[1].get()}))
  {
    return false;
  }
  PI_OS_STEP("offer.sent");
  nonce_ = nonce;
  memory_ = std::move(mapping);
  ring_ = std::move(ring);
  buffers_.assign(RingLayout::CAPACITY, nullptr);
  lengths_.assign(RingLayout::CAPACITY, 0);
  doorbells_ = std::move(doorbells);
  channel_ = std::move(channel);
  tail_ = 0;
  return true;
}

void RingSender::close()
{
  if (!channel_)
  {
    return;
  }
  channel_.close();
  doorbells_ = {};
  ring_->abandon([this](uint32_t ticket) { give(ticket); });
  ring_.reset();
  memory_.reset();
  buffers_ = {};
  lengths_ = {};
  announced_ = {};
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

void RingSender::retire(const std::vector<uint32_t>& segments)
{
  for (uint32_t segment : segments)
  {
    const auto found = std::find(announced_.begin(), announced_.end(), segment);
    if (found != announced_.end())
    {
      announced_.erase(found);
      channel_.send(Packet::of(Packet::RETIRED, segment));  // if it is lost, the subscriber only wastes address space
    }
  }
}

bool RingSender::announce(uint32_t segment)
{
  if (std::find(announced_.begin(), announced_.end(), segment) != announced_.end())
  {
    return true;
  }
  const SlotPool::Segment memory = pool_->segment(segment);
  if (!channel_.send(Packet::of(Packet::SEGMENT, segment, memory.length), {memory.fd}))
  {
    return false;
  }
  announced_.push_back(segment);
  return true;
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
  PI_OS_STEP("send.buffer");
  if (doorbell > 0 && doorbell <= DOORBELLS)
  {
    signalEvent(doorbells_[doorbell - 1].get());
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
  if (!announce(location.segment) ||
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
