#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>

namespace pi_node
{

inline double seconds(int64_t ns)
{
  return 1e-9 * static_cast<double>(ns);
}

/// Rounds towards zero. @param seconds  at most 292 years, which is what int64_t holds in nanoseconds.
inline int64_t nanoseconds(double seconds)
{
  return static_cast<int64_t>(seconds * 1e9);
}

inline double secondsBetween(int64_t from_ns, int64_t to_ns)
{
  return seconds(to_ns - from_ns);
}

/// The monotonic clock [ns]; its zero is the start of the computer. Not the time of ROS.
inline int64_t monotonicNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

inline double secondsSince(std::chrono::steady_clock::time_point time)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - time).count();
}

/// CPU time that this thread, or what another clock of clock_gettime() counts, has taken [s].
inline double cpuSeconds(clockid_t clock = CLOCK_THREAD_CPUTIME_ID)
{
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + seconds(time.tv_nsec);
}

}  // namespace pi_node
