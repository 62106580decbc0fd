#pragma once

#include <chrono>

namespace pi_node
{

/// Limits the rate of a stream by leaving elements out. Not thread safe.
class RateLimit
{
public:
  using Clock = std::chrono::steady_clock;

  /// @param rate_hz  most elements per second on average; 0: no limit.
  explicit RateLimit(double rate_hz)
    : period_(rate_hz > 0.0 ? std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz))
                            : Clock::duration::zero())
  {
  }

  /// @return whether to take the element that comes now. An element may come a quarter of the period early, so that a
  /// stream at a multiple of the rate with some jitter is taken at the rate.
  bool take(Clock::time_point now)
  {
    if (now + period_ / 4 < next_)
    {
      return false;
    }
    next_ = next_ + period_ > now ? next_ + period_ : now + period_;
    return true;
  }

private:
  const Clock::duration period_;
  Clock::time_point next_;
};

}  // namespace pi_node
