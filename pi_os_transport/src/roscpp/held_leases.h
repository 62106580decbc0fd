#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>

#include "preload/zero_copy_api.h"

namespace pi_os_transport
{

/// A received message that is still being read.
class HeldLease
{
public:
  /// @param message  start of the message.
  /// @param held     counts the message when a subscriber holds it.
  HeldLease(const uint8_t* message, std::function<void()> end, std::shared_ptr<std::atomic<uint64_t>> held)
    : message_(message), end_(std::move(end)), held_(std::move(held))
  {
  }
  ~HeldLease();
  HeldLease(const HeldLease&) = delete;
  HeldLease& operator=(const HeldLease&) = delete;

  const uint8_t* message() const { return message_; }
  void noteHeld();

private:
  const uint8_t* const message_;
  const std::function<void()> end_;
  const std::shared_ptr<std::atomic<uint64_t>> held_;
  std::atomic<bool> noted_{false};
};

/// The received messages that zero-copy subscribers of this process may hold, found by address. Never destroyed. Thread
/// safe.
class HeldLeases
{
public:
  static HeldLeases& instance();
  static const PiOsZeroCopyApi& api();

  /// False in processes without such subscribers: then there is no overhead.
  bool wanted() const { return wanted_.load(std::memory_order_relaxed); }
  /// Registers a lease until it ends. @param end  called after the last holder has released it.
  std::shared_ptr<HeldLease> add(const uint8_t* message, std::function<void()> end,
                                 std::shared_ptr<std::atomic<uint64_t>> held);
  std::shared_ptr<HeldLease> find(const uint8_t* message);

private:
  friend class HeldLease;
  void remove(const HeldLease* lease);

  std::atomic<bool> wanted_{false};
  std::mutex mutex_;
  std::unordered_multimap<const uint8_t*, std::pair<const HeldLease*, std::weak_ptr<HeldLease>>> leases_;
};

}  // namespace pi_os_transport
