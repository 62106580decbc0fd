#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

namespace pi_offload
{

/// How much longer a message was on its way than the fastest one lately, though sender and receiver have clocks of
/// their own: those may differ by any amount and drift apart slowly. Not thread safe.
class OneWayDelay
{
public:
  /// @param sent_ns  by the sender's clock. @param received_ns  by the receiver's; never runs backwards.
  /// @return [s], at least 0.
  double excess(int64_t sent_ns, int64_t received_ns)
  {
    if (!begun_ || static_cast<double>(received_ns) - static_cast<double>(since_ns_) >= WINDOW_NS)
    {
      // The least one of this window and the last one counts: clocks drift.
      least_ns_ = {std::numeric_limits<double>::infinity(), least_ns_[0]};
      since_ns_ = received_ns;
      begun_ = true;
    }
    const double difference_ns = static_cast<double>(received_ns) - static_cast<double>(sent_ns);
    least_ns_[0] = std::min(least_ns_[0], difference_ns);
    return (difference_ns - std::min(least_ns_[0], least_ns_[1])) * 1e-9;
  }

private:
  static constexpr double WINDOW_NS = 30e9;
  bool begun_ = false;
  int64_t since_ns_ = 0;
  std::array<double, 2> least_ns_{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
};

}  // namespace pi_offload
