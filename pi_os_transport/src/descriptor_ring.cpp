#include "pi_os_transport/descriptor_ring.h"

#include <algorithm>

namespace pi_os_transport
{
namespace
{

constexpr uint32_t CAPACITY = RingLayout::CAPACITY;
constexpr uint64_t OFFSET_UNIT = 4;  // SerializedMessage buffers start four bytes before an aligned payload

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
  if (occupied_[place])
  {
    return Push::FULL;
  }
  // Who sees what is written here of a place used again must also see that its last message was dropped, see peek().
  std::atomic_thread_fence(std::memory_order_release);
  RingLayout::Entry& entry = layout_->entries[place];
  entry.segment_length.store(uint64_t{descriptor.segment} << 32 | descriptor.length, std::memory_order_relaxed);
  entry.offset_after.store((descriptor.offset / OFFSET_UNIT) << 32 | descriptor.after_tcp, std::memory_order_relaxed);
  entry.serial.store(descriptor.serial, std::memory_order_relaxed);
  entry.stamp_ns.store(descriptor.stamp_ns, std::memory_order_relaxed);
  occupied_[place] = true;
  ++tail_;
  // Sequentially consistent together with the load below: either the subscriber, about to sleep, sees the new tail,
  // or this side sees that it is armed.
  layout_->tail.store(tail_, std::memory_order_seq_cst);
  if (layout_->armed.load(std::memory_order_seq_cst) != 0)
  {
    *doorbell = layout_->armed.exchange(0);
  }
  return Push::WRITTEN;
}

uint32_t RingProducer::inFlight() const
{
  const uint32_t untaken = tail_ - layout_->head.load(std::memory_order_acquire);
  return untaken <= tail_ - oldest_ ? untaken : CAPACITY + 1;  // the head never falls behind what was vacated
}

int RingProducer::dropOldest()
{
  uint32_t head = layout_->head.load(std::memory_order_acquire);
  while (tail_ - head - 1 < CAPACITY)  // 1 .. CAPACITY in flight
  {
    if (!occupied_[head % CAPACITY])
    {
      return -1;  // a peer that moved the head back or released what it never took: its memory was given back already
    }
    if (layout_->head.compare_exchange_weak(head, head + 1, std::memory_order_acq_rel))
    {
      vacate(head % CAPACITY);
      return static_cast<int>(head % CAPACITY);
    }
  }
  return -1;
}

void RingProducer::vacate(uint32_t place)
{
  occupied_[place] = false;
  while (oldest_ != tail_ && !occupied_[oldest_ % CAPACITY])
  {
    ++oldest_;
  }
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
      tail = layout_->tail.load(std::memory_order_seq_cst);
      if (head == tail)
      {
        return false;
      }
      layout_->armed.store(0, std::memory_order_relaxed);
    }
    if (tail - head > CAPACITY)
    {
      // Either the publisher has dropped messages since the head was read, or the tail is none of its making.
      const uint32_t now = layout_->head.load(std::memory_order_relaxed);
      if (now == head)
      {
        broken_ = true;
        return false;
      }
      head = now;
      continue;
    }
    // The publisher may drop this message and write the place anew while it is read here; then the head has moved and
    // what was read is thrown away.
    const RingLayout::Entry& entry = layout_->entries[head % CAPACITY];
    const uint64_t segment_length = entry.segment_length.load(std::memory_order_relaxed);
    const uint64_t offset_after = entry.offset_after.load(std::memory_order_relaxed);
    descriptor->serial = entry.serial.load(std::memory_order_relaxed);
    descriptor->stamp_ns = entry.stamp_ns.load(std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_acquire);
    const uint32_t now = layout_->head.load(std::memory_order_relaxed);
    if (now == head)
    {
      descriptor->segment = static_cast<uint32_t>(segment_length >> 32);
      descriptor->length = static_cast<uint32_t>(segment_length);
      descriptor->offset = (offset_after >> 32) * OFFSET_UNIT;
      descriptor->after_tcp = static_cast<uint32_t>(offset_after);
      *index = head;
      return true;
    }
    head = now;
  }
}

int RingConsumer::takePeeked(uint32_t index)
{
  return layout_->head.compare_exchange_strong(index, index + 1, std::memory_order_acq_rel)
             ? static_cast<int>(index % CAPACITY)
             : -1;
}

RingConsumer::Take RingConsumer::take(uint32_t tcp_delivered, bool in_any_order, Descriptor* descriptor,
                                      uint32_t* place)
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
      *place = static_cast<uint32_t>(taken);
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

void RingConsumer::release(uint32_t place)
{
  layout_->released[place].store(1, std::memory_order_release);
  layout_->release_count.fetch_add(1, std::memory_order_release);
}

}  // namespace pi_os_transport
