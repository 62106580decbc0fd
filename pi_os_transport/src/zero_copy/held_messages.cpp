#include "zero_copy/held_messages.h"

#include "pi_os_transport/zero_copy/subscriber.h"

#include "zero_copy/transport.h"

namespace pi_os_transport::zero_copy
{

PublishedBlocks& PublishedBlocks::instance()
{
  static PublishedBlocks* blocks = new PublishedBlocks;
  return *blocks;
}

bool PublishedBlocks::add(const uint8_t* message, const std::weak_ptr<MemoryBlock>& block)
{
  if (!enabled_.load(std::memory_order_relaxed))
  {
    return false;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  blocks_[message] = block;
  return true;
}

void PublishedBlocks::remove(const uint8_t* message)
{
  std::lock_guard<std::mutex> lock(mutex_);
  blocks_.erase(message);
}

std::shared_ptr<MemoryBlock> PublishedBlocks::find(const uint8_t* message)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = blocks_.find(message);
  return found != blocks_.end() ? found->second.lock() : nullptr;
}

void expectMessagesToHold()
{
  PublishedBlocks::instance().enable();
  if (const PiOsZeroCopyApi* const api = transport())
  {
    api->expect_holds();
  }
}

std::shared_ptr<const void> holdMessage(const uint8_t* message)
{
  if (std::shared_ptr<MemoryBlock> block = PublishedBlocks::instance().find(message))
  {
    return block;
  }
  const PiOsZeroCopyApi* const api = transport();
  void* const hold = api != nullptr ? api->hold(message) : nullptr;
  if (hold == nullptr)
  {
    return nullptr;
  }
  return std::shared_ptr<const void>(hold, [api](const void* held) { api->let_go(const_cast<void*>(held)); });
}

}  // namespace pi_os_transport::zero_copy
