#include "shm/descriptor_ring.h"

#include <algorithm>
#include <limits>

#include "shm/step_mark.h"

namespace pi_os_transport
{
namespace
{

constexpr uint32_t CAPACITY = RingLayout::CAPACITY;
static_assert(CAPACITY - 1 == std::numeric_limits<uint8_t>::max(), "a ticket is one byte");

constexpr uint32_t OFFSET_LOW_BITS = 2;
constexpr uint32_t LENGTH_BITS = 30;
constexpr uint64_t TICKET_BITS = 8;

constexpr uint64_t lowBits(uint64_t value, uint64_t bits)
{
  return value & ((uint64_t{1} << bits) - 1);
}

uint64_t packSegmentLength(const Descriptor& descriptor)
{
  return uint64_t{descriptor.segment} << 32 | lowBits(descriptor.offset, OFFSET_LOW_BITS) << LENGTH_BITS |
         lowBits(descriptor.length, LENGTH_BITS);
}

uint64_t packOffsetAfter(const Descriptor& descriptor)
{
  return descriptor.offset >> OFFSET_LOW_BITS << 32 | descriptor.after_tcp;
}

}  // namespace

RingProducer::RingProducer(RingLayout* layout, uint64_t nonce) : layout_(layout)
{
  layout_->nonce = nonce;
  layout_->magic = RingLayout::MAGIC;
}

RingProducer::Push RingProducer::push(const Descriptor& descriptor, uint32_t* doorbell)
{
  *doorbell = 0;
  const uint32_t place = tail_ % CAPACITY;
  const int ticket = nextTicket();
  if (ticket < 0)
  {
    return Push::FULL;
  }
  tickets_[place] = static_cast<uint8_t>(ticket);
  owners_[ticket] = tail_;
  held_[static_cast<size_t>(ticket) / 64] |= uint64_t{1} << (ticket % 64);
  PI_OS_STEP("push.ticket");
  // A reader that sees the new content of a reused place must also see that its last message was dropped, see peek().
  std::atomic_thread_fence(std::memory_order_release);
  RingLayout::Entry& entry = layout_->entries[place];
  entry.segment_length.store(packSegmentLength(descriptor), std::memory_order_relaxed);
  entry.offset_after.store(packOffsetAfter(descriptor), std::memory_order_relaxed);
  entry.serial_ticket.store(descriptor.serial << TICKET_BITS | static_cast<uint64_t>(ticket),
                            std::memory_order_relaxed);
  entry.stamp_ns.store(descriptor.stamp_ns, std::memory_order_relaxed);
  PI_OS_STEP("push.entry");
  ++tail_;
  // Sequentially consistent together with the load below: either the subscriber sees the new tail before it sleeps, or
  // this side sees that the doorbell is armed.
  layout_->tail.store(tail_, std::memory_order_seq_cst);
  PI_OS_STEP("push.tail");
  if (layout_->armed.load(std::memory_order_seq_cst) != 0)
  {
    *doorbell = layout_->armed.exchange(0);
    PI_OS_STEP("push.disarmed");
  }
  return Push::WRITTEN;
}

int RingProducer::nextTicket() const
{
  const uint32_t preferred = tail_ % CAPACITY;
  if (!isHeld(preferred))
  {
    return static_cast<int>(preferred);
  }
  for (size_t word = 0; word < held_.size(); ++word)
  {
    if (~held_[word] != 0)
    {
      return static_cast<int>(word * 64) + __builtin_ctzll(~held_[word]);
    }
  }
  return -1;
}

int RingProducer::ticketOf(uint32_t index) const
{
  const uint32_t ticket = tickets_[index % CAPACITY];
  return isHeld(ticket) && owners_[ticket] == index ? static_cast<int>(ticket) : -1;
}

uint32_t RingProducer::inFlight()
{
  const uint32_t untaken = tail_ - layout_->head.load(std::memory_order_acquire);
  if (untaken > tail_ - least_head_)
  {
    return CAPACITY + 1;  // a head that moved back, or ahead of the tail
  }
  least_head_ = tail_ - untaken;
  return untaken;
}

int RingProducer::dropOldest()
{
  while (inFlight() - 1 < CAPACITY)  // 1 .. CAPACITY
  {
    uint32_t head = least_head_;
    const int ticket = ticketOf(head);
    if (ticket < 0)
    {
      return -1;
    }
    if (layout_->head.compare_exchange_weak(head, head + 1, std::memory_order_acq_rel))
    {
      PI_OS_STEP("drop.head");
      least_head_ = head + 1;
      vacate(static_cast<uint32_t>(ticket));
      return ticket;
    }
  }
  return -1;
}

bool RingConsumer::peek(Descriptor* descriptor, uint32_t* index)
{
  uint32_t head = layout_->head.load(std::memory_order_acquire);
  for (;;)
  {
    uint32_t tail = layout_->tail.load(std::memory_order_acquire);
    if (head == tail)
    {
      layout_->armed.store(doorbell_, std::memory_order_seq_cst);
      PI_OS_STEP("peek.armed");
      tail = layout_->tail.load(std::memory_order_seq_cst);
      if (head == tail)
      {
        return false;
      }
      layout_->armed.store(0, std::memory_order_relaxed);
    }
    if (tail - head > CAPACITY)
    {
      // Either the publisher has dropped messages since the head was read, or the tail is invalid.
      const uint32_t now = layout_->head.load(std::memory_order_relaxed);
      if (now == head)
      {
        broken_ = true;
        return false;
      }
      head = now;
      continue;
    }
    // The publisher may drop this message and overwrite its place meanwhile. Then the head has moved, and what was read
    // is discarded.
    const RingLayout::Entry& entry = layout_->entries[head % CAPACITY];
    const uint64_t segment_length = entry.segment_length.load(std::memory_order_relaxed);
    const uint64_t offset_after = entry.offset_after.load(std::memory_order_relaxed);
    const uint64_t serial_ticket = entry.serial_ticket.load(std::memory_order_relaxed);
    descriptor->stamp_ns = entry.stamp_ns.load(std::memory_order_relaxed);
    PI_OS_STEP("peek.entry");
    std::atomic_thread_fence(std::memory_order_acquire);
    const uint32_t now = layout_->head.load(std::memory_order_relaxed);
    if (now == head)
    {
      descriptor->segment = static_cast<uint32_t>(segment_length >> 32);
      descriptor->length = static_cast<uint32_t>(lowBits(segment_length, LENGTH_BITS));
      descriptor->offset =
          offset_after >> 32 << OFFSET_LOW_BITS | lowBits(segment_length >> LENGTH_BITS, OFFSET_LOW_BITS);
      descriptor->after_tcp = static_cast<uint32_t>(offset_after);
      descriptor->serial = serial_ticket >> TICKET_BITS;
      peeked_ticket_ = static_cast<uint32_t>(lowBits(serial_ticket, TICKET_BITS));
      *index = head;
      return true;
    }
    head = now;
  }
}

int RingConsumer::takePeeked(uint32_t index)
{
  if (!layout_->head.compare_exchange_strong(index, index + 1, std::memory_order_acq_rel))
  {
    return -1;
  }
  PI_OS_STEP("take.head");
  return static_cast<int>(peeked_ticket_);
}

RingConsumer::Take RingConsumer::take(uint32_t tcp_delivered, bool in_any_order, Descriptor* descriptor,
                                      uint32_t* ticket)
{
  uint32_t index;
  while (peek(descriptor, &index))
  {
    if (!in_any_order && static_cast<int32_t>(descriptor->after_tcp - tcp_delivered) > 0)
    {
      return Take::WAITING;
    }
    const int taken = takePeeked(index);
    if (taken >= 0)
    {
      *ticket = static_cast<uint32_t>(taken);
      return Take::TAKEN;
    }
  }
  return Take::EMPTY;
}

uint32_t RingConsumer::available() const
{
  const uint32_t head = layout_->head.load(std::memory_order_acquire);
  return std::min(layout_->tail.load(std::memory_order_acquire) - head, CAPACITY);
}

void RingConsumer::release(uint32_t ticket)
{
  layout_->released[ticket].store(1, std::memory_order_release);
  PI_OS_STEP("release.mark");
  layout_->release_count.fetch_add(1, std::memory_order_release);
  PI_OS_STEP("release.count");
}

}  // namespace pi_os_transport
