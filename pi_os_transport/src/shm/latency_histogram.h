#pragma once

#include <time.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace pi_os_transport
{

/// The monotonic clock, the same for all processes of a device [ns].
inline uint64_t monotonicNs()
{
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<uint64_t>(now.tv_sec) * 1000000000 + static_cast<uint64_t>(now.tv_nsec);
}

/// Counts durations: bucket 0 below 1.024 us, bucket n below 1.024 * 2^n us, the last bucket all longer ones. Not
/// thread safe.
class LatencyHistogram
{
public:
  static constexpr size_t BUCKETS = 24;
  using Counts = std::array<uint64_t, BUCKETS>;

  void add(uint64_t duration_ns)
  {
    const uint64_t units = duration_ns >> 10;
    const auto bits = units == 0 ? 0 : 64 - static_cast<size_t>(__builtin_clzll(units));
    ++counts_[std::min(bits, BUCKETS - 1)];
  }
  /// Adds the time since `start_ns`, at least 0.
  void addSince(uint64_t start_ns)
  {
    const uint64_t now = monotonicNs();
    add(now > start_ns ? now - start_ns : 0);
  }
  const Counts& counts() const { return counts_; }

private:
  Counts counts_{};
};

}  // namespace pi_os_transport
