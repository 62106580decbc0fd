#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace pi_node
{

/// The clock of everything in the vehicle that waits for something [ns]: watchdogs, timeouts, periods. Monotonic on a
/// vehicle; in simulated time that of the simulator, from 0 on, which goes at any pace, may stand still, and jumps back
/// when a recording begins anew. Good for differences only. Any thread.
int64_t vehicleNs();

/// Whether vehicleNs() is simulated.
bool isTimeSimulated();

/// @param clock  of simulated time; null: monotonic again.
void simulateTime(int64_t (*clock)());

/// How often a thread looks at a simulated clock, which nobody can sleep by.
constexpr std::chrono::milliseconds SIMULATED_LOOK(2);

/// As std::condition_variable::wait_until, until a time of vehicleNs(); a clock that jumps back ends it too.
template <typename Predicate>
bool waitUntil(std::condition_variable* changed, std::unique_lock<std::mutex>* lock, int64_t until_ns,
               Predicate predicate)
{
  const int64_t begin_ns = vehicleNs();
  if (!isTimeSimulated())
  {
    return changed->wait_for(*lock, std::chrono::nanoseconds(until_ns - begin_ns), predicate);
  }
  for (int64_t now_ns = begin_ns; now_ns >= begin_ns && now_ns < until_ns; now_ns = vehicleNs())
  {
    if (changed->wait_for(*lock, SIMULATED_LOOK, predicate))
    {
      return true;
    }
  }
  return predicate();
}

/// As std::condition_variable::wait_for, in the vehicle's time.
template <typename Predicate>
bool waitFor(std::condition_variable* changed, std::unique_lock<std::mutex>* lock, double seconds, Predicate predicate)
{
  return waitUntil(changed, lock, vehicleNs() + static_cast<int64_t>(1e9 * seconds), predicate);
}

}  // namespace pi_node
