#include <pi_node/durations.h>
#include <pi_runtime/task.h>

#include <linux/futex.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "core/runtime_core.h"

namespace pi_runtime
{
namespace
{

/// Waits until `ended` is set. @param until  absolute CLOCK_MONOTONIC; null: no limit.
void waitForEnd(std::atomic<uint32_t>& ended, const timespec* until)
{
  static_assert(sizeof(std::atomic<uint32_t>) == sizeof(uint32_t), "a futex is a plain word");
  syscall(SYS_futex, &ended, FUTEX_WAIT_BITSET_PRIVATE, 0, until, nullptr, FUTEX_BITSET_MATCH_ANY);
}

}  // namespace

uint64_t TaskHandle::id() const
{
  return state_->id;
}

bool TaskHandle::ready() const
{
  return state_->ended.load(std::memory_order_acquire) != 0;
}

const TaskResult& TaskHandle::wait() const
{
  ++state_->waiters;
  while (!ready())
  {
    waitForEnd(state_->ended, nullptr);
  }
  --state_->waiters;
  return state_->result;
}

bool TaskHandle::waitFor(std::chrono::nanoseconds timeout) const
{
  const int64_t until_ns = timeAfter(pi_node::monotonicNs(), timeout);
  const timespec until = {until_ns / 1000000000, until_ns % 1000000000};
  ++state_->waiters;
  while (!ready() && pi_node::monotonicNs() < until_ns)
  {
    waitForEnd(state_->ended, &until);
  }
  --state_->waiters;
  return ready();
}

void TaskHandle::cancel() const
{
  if (const std::shared_ptr<RuntimeCore> core = state_->core.lock())
  {
    core->cancel(*state_);
  }
}

}  // namespace pi_runtime
