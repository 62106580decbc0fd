#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>

#include "pi_os_transport/zero_copy/arena.h"

namespace pi_os_transport::zero_copy
{

/// The published loans that subscribers in this process still read. Never destroyed, because messages may outlive
/// static objects. Thread safe.
class PublishedBlocks
{
public:
  static PublishedBlocks& instance();

  /// Starts recording: most processes have no such subscribers.
  void enable() { enabled_.store(true, std::memory_order_relaxed); }
  /// @return false if nothing is recorded.
  bool add(const uint8_t* message, const std::weak_ptr<MemoryBlock>& block);
  void remove(const uint8_t* message);
  std::shared_ptr<MemoryBlock> find(const uint8_t* message);

private:
  std::atomic<bool> enabled_{false};
  std::mutex mutex_;
  std::unordered_map<const uint8_t*, std::weak_ptr<MemoryBlock>> blocks_;
};

}  // namespace pi_os_transport::zero_copy
