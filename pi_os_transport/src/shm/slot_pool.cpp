#include "shm/slot_pool.h"

#include <pthread.h>
#include <sys/mman.h>

#include <algorithm>

#include "shm/shared_memory.h"
#include "shm/step_mark.h"

namespace pi_os_transport
{
namespace
{

constexpr uint64_t PAGE = 4096;
constexpr uint64_t SLOT_HEADER = 64;
constexpr uint64_t PAYLOAD_SHIFT = 4;                 // see allocate()
constexpr uint64_t SMALLEST_SEGMENT = 64 << 10;       // [B]
constexpr uint64_t LARGEST_SHARED_SEGMENT = 1 << 20;  // segments of slots smaller than this grow up to it [B]
constexpr uint64_t LARGEST_MESSAGE = 1 << 30;         // roscpp refuses messages of more than 10^9 bytes [B]
constexpr uint32_t CLASS_BASE = 7;                    // smallest slot: 2^7 B
constexpr uint32_t LOOK_UP_CLASSES = 4;  // a free slot up to four classes (1.5 times) larger is good enough

uint64_t roundUp(uint64_t value, uint64_t unit)
{
  return (value + unit - 1) / unit * unit;
}

struct AddressRange
{
  std::atomic<uint8_t*> base{nullptr};
  std::atomic<uint64_t> length{0};
};

/// The address ranges of all pools. A forked child replaces them by empty mappings: it must not hold the memory, but
/// must recognise the addresses.
struct PoolRanges
{
  static constexpr size_t MAX_POOLS = 8;  // one per process; tests make a few

  static void add(uint8_t* base, uint64_t length)
  {
    static const int registered = pthread_atfork(nullptr, nullptr, emptyAll);
    static_cast<void>(registered);
    for (AddressRange& range : ranges)
    {
      uint8_t* none = nullptr;
      if (range.base.compare_exchange_strong(none, base))
      {
        range.length = length;
        return;
      }
    }
  }
  static void remove(uint8_t* base)
  {
    for (AddressRange& range : ranges)
    {
      uint8_t* expected = base;
      if (range.base.compare_exchange_strong(expected, nullptr))
      {
        return;
      }
    }
  }
  static void emptyAll()
  {
    for (AddressRange& range : ranges)
    {
      if (uint8_t* base = range.base.load())
      {
        mmap(base, range.length, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED, -1, 0);
      }
    }
  }

  static inline AddressRange ranges[MAX_POOLS];
};

}  // namespace

/// The header before a message. A message moved by place() has a second header that only points to the header of the
/// slot.
struct alignas(SLOT_HEADER) SlotPool::Slot
{
  Slot* slot;  // itself, or the slot that place() was given
  std::atomic<uint32_t> references;
  uint32_t size_class;
  uint32_t segment;
  uint64_t capacity;  // header included [B]
  Slot* next_free;

  uint8_t* payload() { return reinterpret_cast<uint8_t*>(this) + SLOT_HEADER - PAYLOAD_SHIFT; }
  static Slot* before(const uint8_t* payload)
  {
    const uintptr_t address = reinterpret_cast<uintptr_t>(payload) - (SLOT_HEADER - PAYLOAD_SHIFT);
    return reinterpret_cast<Slot*>(address / SLOT_HEADER * SLOT_HEADER);
  }
  static Slot* of(const uint8_t* payload) { return before(payload)->slot; }
};

SlotPool::SlotPool(uint64_t limit_bytes) : limit_(roundUp(limit_bytes, PAGE))
{
  void* address = mmap(nullptr, limit_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (address == MAP_FAILED)
  {
    last_error_ = describeFailure("reservation of address space for the message pool", limit_);
    return;
  }
  base_ = static_cast<uint8_t*>(address);
  reserved_ = limit_;
  PoolRanges::add(base_, reserved_);
}

SlotPool::~SlotPool()
{
  segments_.clear();
  if (base_ != nullptr)
  {
    PoolRanges::remove(base_);
    munmap(base_, reserved_);
  }
}

uint64_t SlotPool::roundToClass(uint64_t total, uint32_t* size_class)
{
  // Eight classes per doubling, all multiples of a cache line, and of a page from 32 kiB on.
  total = std::max<uint64_t>(total, 1 << CLASS_BASE);
  uint32_t exponent = 63 - __builtin_clzll(total);
  const uint64_t step = std::max<uint64_t>((uint64_t{1} << exponent) / 8, SLOT_HEADER);
  const uint64_t capacity = roundUp(total, step);
  exponent = 63 - __builtin_clzll(capacity);
  const uint64_t base = uint64_t{1} << exponent;
  *size_class = (exponent - CLASS_BASE) * 8 + static_cast<uint32_t>((capacity - base) / (base / 8));
  return capacity;
}

uint8_t* SlotPool::allocate(size_t bytes)
{
  if (isForkedChild() || base_ == nullptr)
  {
    return nullptr;
  }
  uint32_t size_class = 0;
  if (bytes > std::min(limit_, LARGEST_MESSAGE))
  {
    std::lock_guard<std::mutex> lock(mutex_);
    last_error_ = "a message of " + std::to_string(bytes) + " bytes is larger than the pool's limit of " +
                  std::to_string(std::min(limit_, LARGEST_MESSAGE)) + " bytes";
    return nullptr;
  }
  const uint64_t total = bytes + SLOT_HEADER;  // the shift leaves 4 spare bytes at the end
  const uint64_t capacity = roundToClass(total, &size_class);
  for (bool reclaimed = false;; reclaimed = true)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    uint8_t* payload = popFree(size_class, total);
    if (payload == nullptr && reclaimed)
    {
      payload = carve(capacity, size_class);
      if (payload == nullptr && grow(capacity))
      {
        payload = carve(capacity, size_class);
      }
    }
    if (payload != nullptr)
    {
      PI_OS_STEP("allocate.slot");
      Slot* slot = Slot::of(payload);
      slot->references.store(1, std::memory_order_relaxed);
      ++recordOf(slot->segment)->live;
      return payload;
    }
    if (reclaimed)
    {
      return nullptr;
    }
    lock.unlock();
    if (reclaim_)
    {
      reclaim_();
    }
  }
}

uint8_t* SlotPool::popFree(uint32_t size_class, uint64_t total)
{
  for (uint32_t candidate = size_class; candidate < std::min(size_class + LOOK_UP_CLASSES, CLASSES); ++candidate)
  {
    Slot* slot = free_[candidate];
    if (slot != nullptr && slot->capacity >= total)
    {
      free_[candidate] = slot->next_free;
      return slot->payload();
    }
  }
  return nullptr;
}

uint8_t* SlotPool::carve(uint64_t capacity, uint32_t size_class)
{
  for (SegmentRecord& record : segments_)
  {
    if (record.length - record.carved >= capacity)
    {
      Slot* slot = reinterpret_cast<Slot*>(record.start + record.carved);
      record.carved += capacity;
      ++record.slots;
      ++class_slots_[size_class];
      slot->slot = slot;
      slot->size_class = size_class;
      slot->segment = record.id;
      slot->capacity = capacity;
      slot->next_free = nullptr;
      return slot->payload();
    }
  }
  return nullptr;
}

bool SlotPool::grow(uint64_t capacity)
{
  if (recycleIdle(capacity))
  {
    return true;
  }
  // Small slots share segments. Each new segment of large slots has half as many slots as exist already: memory stays
  // close to need, and the number of segments (one descriptor and one mapping per peer) stays small.
  uint64_t shared = 0;
  for (const SegmentRecord& record : segments_)
  {
    shared += record.length <= LARGEST_SHARED_SEGMENT ? record.length : 0;
  }
  shared = std::clamp(shared / 2, SMALLEST_SEGMENT, LARGEST_SHARED_SEGMENT);
  uint32_t size_class = 0;
  roundToClass(capacity, &size_class);
  const uint64_t wanted = capacity * 4 <= LARGEST_SHARED_SEGMENT
                              ? std::max(shared, capacity)
                              : capacity * std::max(1U, class_slots_[size_class] / 2);
  const uint64_t lengths[] = {roundUp(wanted, PAGE), roundUp(capacity, PAGE)};
  for (uint64_t length : lengths)
  {
    if (committed_ + length > limit_)
    {
      trimLocked();
    }
    if (committed_ + length <= limit_ && makeSegment(length))
    {
      return true;
    }
  }
  if (committed_ + lengths[1] > limit_)
  {
    last_error_ =
        "the pool limit of " + std::to_string(limit_) + " bytes is reached (" + std::to_string(committed_) + " in use)";
  }
  return false;
}

uint8_t* SlotPool::findAddress(uint64_t length) const
{
  uint8_t* candidate = base_;
  for (const SegmentRecord& record : segments_)
  {
    if (static_cast<uint64_t>(record.start - candidate) >= length)
    {
      return candidate;
    }
    candidate = record.start + record.length;
  }
  return static_cast<uint64_t>(base_ + reserved_ - candidate) >= length ? candidate : nullptr;
}

bool SlotPool::makeSegment(uint64_t length)
{
  uint8_t* address = findAddress(length);
  if (address == nullptr)
  {
    last_error_ = "the address space of the message pool is fragmented";
    return false;
  }
  FileDescriptor memory = makeSharedMemory("pi_os_pool", length, &last_error_);
  if (!memory)
  {
    return false;
  }
  if (mmap(address, length, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED | MAP_POPULATE, memory.get(), 0) ==
      MAP_FAILED)
  {
    last_error_ = describeFailure("mapping of shared memory", length);
    return false;
  }
  sealSharedMemory(memory.get(), true);
  SegmentRecord record;
  record.id = next_segment_++;
  record.start = address;
  record.length = length;
  record.fd = std::move(memory);
  committed_ += length;
  const auto position = std::find_if(segments_.begin(), segments_.end(),
                                     [address](const SegmentRecord& other) { return other.start > address; });
  segments_.insert(position, std::move(record));
  return true;
}

bool SlotPool::recycleIdle(uint64_t capacity)
{
  for (SegmentRecord& record : segments_)
  {
    if (record.live == 0 && record.length >= capacity && record.length <= capacity * 4)
    {
      forgetSlots(record);
      record.carved = 0;
      record.slots = 0;
      return true;
    }
  }
  return false;
}

void SlotPool::forgetSlots(const SegmentRecord& record)
{
  for (uint32_t size_class = 0; size_class < CLASSES; ++size_class)
  {
    for (Slot** link = &free_[size_class]; *link != nullptr;)
    {
      if ((*link)->segment == record.id)
      {
        --class_slots_[size_class];
        *link = (*link)->next_free;
      }
      else
      {
        link = &(*link)->next_free;
      }
    }
  }
}

void SlotPool::destroy(size_t index)
{
  SegmentRecord& record = segments_[index];
  forgetSlots(record);
  mmap(record.start, record.length, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED, -1, 0);
  committed_ -= record.length;
  retired_.push_back(record.id);
  any_retired_.store(true, std::memory_order_release);
  segments_.erase(segments_.begin() + static_cast<std::ptrdiff_t>(index));
}

void SlotPool::trimLocked()
{
  for (size_t index = segments_.size(); index-- > 0;)
  {
    if (segments_[index].live == 0)
    {
      destroy(index);
    }
  }
}

void SlotPool::trim()
{
  if (isForkedChild())
  {
    return;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  trimLocked();
}

std::vector<uint32_t> SlotPool::takeRetired()
{
  std::vector<uint32_t> retired;
  if (any_retired_.load(std::memory_order_acquire))
  {
    std::lock_guard<std::mutex> lock(mutex_);
    retired.swap(retired_);
    any_retired_.store(false, std::memory_order_relaxed);
  }
  return retired;
}

void SlotPool::addReference(const uint8_t* payload)
{
  Slot::of(payload)->references.fetch_add(1, std::memory_order_relaxed);
  PI_OS_STEP("share.reference");
}

uint64_t SlotPool::capacity(const uint8_t* payload) const
{
  return Slot::of(payload)->capacity - (SLOT_HEADER - PAYLOAD_SHIFT);
}

void SlotPool::place(uint8_t* payload, uint8_t* message)
{
  Slot* const header = Slot::before(message);
  Slot* const slot = Slot::of(payload);
  if (header != slot)
  {
    header->slot = slot;
  }
}

void SlotPool::release(const uint8_t* payload)
{
  if (isForkedChild())
  {
    return;
  }
  Slot* slot = Slot::of(payload);
  if (slot->references.fetch_sub(1, std::memory_order_acq_rel) != 1)
  {
    return;
  }
  PI_OS_STEP("free.reference");
  std::lock_guard<std::mutex> lock(mutex_);
  --recordOf(slot->segment)->live;
  slot->next_free = free_[slot->size_class];
  free_[slot->size_class] = slot;
  PI_OS_STEP("free.slot");
}

SlotPool::Location SlotPool::locate(const uint8_t* payload) const
{
  std::lock_guard<std::mutex> lock(mutex_);
  const SegmentRecord* record = recordOf(Slot::of(payload)->segment);
  return Location{record->id, static_cast<uint64_t>(payload - record->start)};
}

SlotPool::Segment SlotPool::segment(uint32_t id) const
{
  std::lock_guard<std::mutex> lock(mutex_);
  const SegmentRecord* record = recordOf(id);
  return record != nullptr ? Segment{record->fd.get(), record->length} : Segment{-1, 0};
}

SlotPool::SegmentRecord* SlotPool::recordOf(uint32_t id)
{
  return const_cast<SegmentRecord*>(static_cast<const SlotPool*>(this)->recordOf(id));
}

const SlotPool::SegmentRecord* SlotPool::recordOf(uint32_t id) const
{
  for (const SegmentRecord& record : segments_)
  {
    if (record.id == id)
    {
      return &record;
    }
  }
  return nullptr;
}

SlotPool::Usage SlotPool::usage() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  Usage usage{committed_, limit_, static_cast<uint32_t>(segments_.size()), 0};
  for (const SegmentRecord& record : segments_)
  {
    usage.live_slots += record.live;
  }
  return usage;
}

std::string SlotPool::lastError() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return last_error_;
}

}  // namespace pi_os_transport
