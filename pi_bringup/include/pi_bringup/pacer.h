#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace pi_bringup
{

/// Nanoseconds of the monotonic clock, the time base of all pacing.
int64_t monotonicNow();

/// How far behind its due time each message was handed to the transport. Not thread safe.
class LatenessStatistics
{
public:
  /// @param lateness_ns due time to hand-over [ns]; negative values (early) count as 0.
  void record(int64_t lateness_ns);

  uint64_t count() const { return count_; }
  uint64_t overOneMillisecond() const { return over_1ms_; }
  uint64_t overTenMilliseconds() const { return over_10ms_; }
  int64_t maxNs() const { return max_ns_; }
  /// Mean [ns]; 0 before the first sample.
  double meanNs() const { return count_ == 0 ? 0.0 : sum_ns_ / static_cast<double>(count_); }

private:
  uint64_t count_ = 0;
  uint64_t over_1ms_ = 0;
  uint64_t over_10ms_ = 0;
  int64_t max_ns_ = 0;
  double sum_ns_ = 0.0;
};

/// Maps recorded time to the monotonic clock and waits for it. Deadlines are absolute, so delays do not add up.
/// One thread waits; stop() may be called from any thread.
class Pacer
{
public:
  /// @param rate recorded seconds per second of real time, > 0.
  /// @throws std::invalid_argument for another rate.
  explicit Pacer(double rate);

  /// From now on, recorded time `recorded_ns` is due at monotonic time `monotonic_ns`.
  void start(int64_t recorded_ns, int64_t monotonic_ns);

  /// Monotonic time at which `recorded_ns` is due.
  int64_t dueTime(int64_t recorded_ns) const;

  /// Blocks until `recorded_ns` is due; returns at once when it is past. @return false after stop().
  bool waitUntil(int64_t recorded_ns);

  /// Ends the current and every later wait.
  void stop();

private:
  const double rate_;
  int64_t recorded_start_ns_ = 0;
  int64_t monotonic_start_ns_ = 0;
  std::mutex mutex_;
  std::condition_variable stopped_changed_;
  bool stopped_ = false;
};

}  // namespace pi_bringup
