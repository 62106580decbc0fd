#pragma once

#include <cstdint>
#include <limits>

namespace pi_node
{

/// Limits the rate of a stream by leaving elements out. Not thread safe.
class RateLimit
{
public:
  /// @param rate_hz  most elements per second on average; 0: no limit.
  explicit RateLimit(double rate_hz) : period_ns_(rate_hz > 0.0 ? static_cast<int64_t>(1e9 / rate_hz) : 0) {}

  /// @return whether to take the element that comes now. An element may come a quarter of the period early, so that a
  /// stream at a multiple of the rate with some jitter is taken at the rate.
  /// @param now_ns  its stamp, or vehicleNs() if it has none; if time went back, the stream begins anew.
  bool take(int64_t now_ns)
  {
    const int64_t early_ns = next_ns_ - now_ns;
    const bool back = early_ns > 2 * period_ns_;
    if (early_ns > period_ns_ / 4 && !back)
    {
      return false;
    }
    next_ns_ = !back && next_ns_ + period_ns_ > now_ns ? next_ns_ + period_ns_ : now_ns + period_ns_;
    return true;
  }

private:
  const int64_t period_ns_;
  int64_t next_ns_ = std::numeric_limits<int64_t>::min() / 2;
};

}  // namespace pi_node
