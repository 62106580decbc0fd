#pragma once

#include <chrono>

namespace pi_node
{

/// Leaves out of a stream what comes faster than a rate. Not thread safe.
class RateLimit
{
public:
  using Clock = std::chrono::steady_clock;

  /// @param rate_hz  that is kept on average; 0: nothing is left out.
  explicit RateLimit(double rate_hz)
    : period_(rate_hz > 0.0 ? std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz))
                            : Clock::duration::zero())
  {
  }

  /// @return whether what comes now is to be taken. A quarter of the period may be missing: what comes at a multiple of
  /// the rate, but not quite evenly, is taken at the rate.
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
