#include "roscpp/held_leases.h"

#include <utility>

#include "roscpp/runtime.h"

namespace pi_os_transport
{
namespace
{

uint8_t* allocate(size_t bytes, size_t* capacity)
{
  Runtime& runtime = Runtime::instance();
  if (!runtime.active() || !runtime.options.enable || runtime.active_transmit_links == 0)
  {
    return nullptr;
  }
  uint8_t* const memory = runtime.pool().allocate(bytes);
  if (memory != nullptr)
  {
    *capacity = runtime.pool().capacity(memory);
  }
  return memory;
}

void place(uint8_t* memory, uint8_t* message)
{
  if (Runtime::instance().active())
  {
    Runtime::instance().pool().place(memory, message);
  }
}

void release(const uint8_t* memory)
{
  Runtime::instance().pool().release(memory);
}

void* hold(const uint8_t* message)
{
  if (!Runtime::instance().active())
  {
    return nullptr;
  }
  std::shared_ptr<HeldLease> lease = HeldLeases::instance().find(message);
  if (!lease)
  {
    return nullptr;
  }
  lease->noteHeld();
  return new std::shared_ptr<HeldLease>(std::move(lease));
}

void letGo(void* hold)
{
  delete static_cast<std::shared_ptr<HeldLease>*>(hold);
}

}  // namespace

HeldLease::~HeldLease()
{
  if (!Runtime::instance().active())
  {
    return;  // a forked child: a thread that does not exist here may hold the lock
  }
  HeldLeases::instance().remove(this);
  end_();
}

void HeldLease::noteHeld()
{
  if (!noted_.exchange(true, std::memory_order_relaxed))
  {
    held_->fetch_add(1, std::memory_order_relaxed);
  }
}

HeldLeases& HeldLeases::instance()
{
  static HeldLeases* leases = new HeldLeases;
  return *leases;
}

const PiOsZeroCopyApi& HeldLeases::api()
{
  static const PiOsZeroCopyApi functions{
      PI_OS_ZERO_COPY_VERSION, allocate, place, release, []() { instance().wanted_ = true; }, hold, letGo};
  return functions;
}

std::shared_ptr<HeldLease> HeldLeases::add(const uint8_t* message, std::function<void()> end,
                                           std::shared_ptr<std::atomic<uint64_t>> held)
{
  const auto lease = std::make_shared<HeldLease>(message, std::move(end), std::move(held));
  std::lock_guard<std::mutex> lock(mutex_);
  leases_.emplace(message, std::make_pair(lease.get(), lease));
  return lease;
}

std::shared_ptr<HeldLease> HeldLeases::find(const uint8_t* message)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto range = leases_.equal_range(message);
  for (auto entry = range.first; entry != range.second; ++entry)
  {
    if (std::shared_ptr<HeldLease> lease = entry->second.second.lock())
    {
      return lease;
    }
  }
  return nullptr;
}

void HeldLeases::remove(const HeldLease* lease)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto range = leases_.equal_range(lease->message());
  for (auto entry = range.first; entry != range.second; ++entry)
  {
    if (entry->second.first == lease)
    {
      leases_.erase(entry);
      return;
    }
  }
}

}  // namespace pi_os_transport
