#include "sensors/sample_clock.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_vehicle
{
namespace
{

constexpr int64_t NO_DELAY_YET = std::numeric_limits<int64_t>::max();
constexpr double LATE = 0.75;  ///< of a period

}  // namespace

SampleClock::SampleClock(double rate)
  : period_ns_(pi_node::nanoseconds(1.0 / rate))
  , settling_(std::lround(std::ceil(SETTLING_S * rate)))
  , window_(std::lround(std::ceil(WINDOW_S * rate)))
{
}

void SampleClock::restart()
{
  samples_ = 0;
}

void SampleClock::skip()
{
  expected_ns_ += period_ns_;
}

std::optional<int64_t> SampleClock::sample(int64_t arrival_ns)
{
  if (samples_ > 0 && pi_node::secondsBetween(arrival_ns_, arrival_ns) > std::max(LONGEST_GAP_S, 1e-9 * 3 * period_ns_))
  {
    restart();
  }
  arrival_ns_ = arrival_ns;
  expected_ns_ += period_ns_;
  if (samples_ == 0)
  {
    expected_ns_ = arrival_ns;
    least_ns_ = NO_DELAY_YET;
  }
  ++samples_;
  const int64_t delay_ns = std::max<int64_t>(0, arrival_ns - expected_ns_);
  const auto creep_ns = static_cast<int64_t>(CREEP * static_cast<double>(period_ns_));
  expected_ns_ = std::min(arrival_ns, expected_ns_ + creep_ns);
  least_ns_ = std::min(least_ns_, delay_ns);
  if (samples_ % window_ == 0)
  {
    const double late = static_cast<double>(least_ns_) / static_cast<double>(period_ns_);
    if (late > LATE)
    {
      const int64_t lost = std::max<int64_t>(1, std::llround(late));
      missed_ += static_cast<uint64_t>(lost);
      expected_ns_ = std::min(arrival_ns, expected_ns_ + lost * period_ns_);
    }
    least_ns_ = NO_DELAY_YET;
  }
  if (samples_ <= settling_)
  {
    return std::nullopt;
  }
  stamp_ns_ = std::max(stamp_ns_ + 1000, expected_ns_);  // a line that was lowered must not turn time back
  return stamp_ns_;
}

}  // namespace pi_vehicle
