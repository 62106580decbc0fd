#include <pi_bringup/pacer.h>

#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_bringup
{

int64_t monotonicNow()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

void LatenessStatistics::record(int64_t lateness_ns)
{
  const int64_t late_ns = lateness_ns < 0 ? 0 : lateness_ns;
  ++count_;
  sum_ns_ += static_cast<double>(late_ns);
  max_ns_ = late_ns > max_ns_ ? late_ns : max_ns_;
  over_1ms_ += late_ns > 1000000 ? 1 : 0;
  over_10ms_ += late_ns > 10000000 ? 1 : 0;
}

Pacer::Pacer(double rate) : rate_(rate)
{
  if (!(rate > 0.0) || !std::isfinite(rate))
  {
    throw std::invalid_argument("Pacer: rate = " + std::to_string(rate) + ", must be a finite number above 0");
  }
}

void Pacer::start(int64_t recorded_ns, int64_t monotonic_ns)
{
  recorded_start_ns_ = recorded_ns;
  monotonic_start_ns_ = monotonic_ns;
}

int64_t Pacer::dueTime(int64_t recorded_ns) const
{
  const int64_t elapsed_ns = recorded_ns - recorded_start_ns_;
  // Exact at true rate: a double holds no more than 53 bits of nanoseconds.
  const int64_t scaled_ns =
      rate_ == 1.0 ? elapsed_ns : static_cast<int64_t>(std::llround(static_cast<double>(elapsed_ns) / rate_));
  return monotonic_start_ns_ + scaled_ns;
}

bool Pacer::waitUntil(int64_t recorded_ns)
{
  const std::chrono::steady_clock::time_point deadline{std::chrono::nanoseconds(dueTime(recorded_ns))};
  std::unique_lock<std::mutex> lock(mutex_);
  stopped_changed_.wait_until(lock, deadline, [this] { return stopped_; });
  return !stopped_;
}

void Pacer::stop()
{
  std::lock_guard<std::mutex> lock(mutex_);
  stopped_ = true;
  stopped_changed_.notify_all();
}

}  // namespace pi_bringup
