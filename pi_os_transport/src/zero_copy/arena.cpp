#include "pi_os_transport/zero_copy/arena.h"

#include <algorithm>
#include <limits>
#include <new>

#include "zero_copy/held_messages.h"
#include "zero_copy/transport.h"

namespace pi_os_transport::zero_copy
{
namespace
{

constexpr std::align_val_t HEAP_ALIGNMENT{Arena::ALIGNMENT};
/// The pool's memory starts this far before a multiple of ALIGNMENT, which aligns the array behind HEADROOM [B].
constexpr size_t BEFORE_ALIGNED = 4;
static_assert((MemoryBlock::HEADROOM - BEFORE_ALIGNED) % Arena::ALIGNMENT == 0);

/// The same offset for memory on the heap.
uint8_t* allocateOnHeap(size_t bytes)
{
  const size_t lead = Arena::ALIGNMENT - BEFORE_ALIGNED;
  return static_cast<uint8_t*>(::operator new(bytes + lead, HEAP_ALIGNMENT)) + lead;
}

void freeOnHeap(uint8_t* memory)
{
  ::operator delete(memory - (Arena::ALIGNMENT - BEFORE_ALIGNED), HEAP_ALIGNMENT);
}

}  // namespace

MemoryBlock::MemoryBlock(size_t array_bytes) : array_bytes_(array_bytes)
{
  constexpr size_t ROOM = HEADROOM + TAILROOM;
  if (array_bytes > std::numeric_limits<size_t>::max() - ROOM - Arena::ALIGNMENT)
  {
    throw std::bad_alloc();
  }
  capacity_ = array_bytes + ROOM;
  if (const PiOsZeroCopyApi* const api = transport())
  {
    memory_ = api->allocate(capacity_, &capacity_);
    shared_ = memory_ != nullptr;
  }
  if (!shared_)
  {
    memory_ = allocateOnHeap(capacity_);
  }
}

MemoryBlock::~MemoryBlock()
{
  if (message_ != nullptr)
  {
    PublishedBlocks::instance().remove(message_);
  }
  if (shared_)
  {
    transport()->release(memory_);
  }
  else
  {
    freeOnHeap(memory_);
  }
}

void MemoryBlock::startAt(uint8_t* start)
{
  if (shared_)
  {
    transport()->place(memory_, start);
  }
  const uint8_t* const message = start + 4;
  if (PublishedBlocks::instance().add(message, weak_from_this()))
  {
    message_ = message;
  }
}

void* Arena::allocate(size_t bytes)
{
  blocks_.push_back(std::make_shared<MemoryBlock>(bytes));
  return blocks_.back()->array();
}

void Arena::deallocate(const void* array) noexcept
{
  const auto found =
      std::find_if(blocks_.begin(), blocks_.end(), [array](const auto& block) { return block->array() == array; });
  if (found != blocks_.end())
  {
    blocks_.erase(found);
  }
}

std::shared_ptr<MemoryBlock> Arena::largest() const
{
  const auto found =
      std::max_element(blocks_.begin(), blocks_.end(),
                       [](const auto& left, const auto& right) { return left->arrayBytes() < right->arrayBytes(); });
  return found != blocks_.end() ? *found : nullptr;
}

}  // namespace pi_os_transport::zero_copy
