#pragma once

#include <cstdint>
#include <optional>

namespace pi_vehicle
{

/// When a device took the samples that it takes at a fixed rate, from their arrivals, which a serial line, a USB
/// adapter and a busy computer delay by times that vary.
///
/// Samples are numbered, and their times are a straight line over the number that lies below all arrivals: the least
/// delay counts as none. An arrival below the line lowers it at once; else it rises by at most CREEP of a period per
/// sample, so it follows a device whose clock is slower than its nominal rate. Lost samples of which nothing came show
/// as arrivals that are all late by whole periods. Not thread safe.
class SampleClock
{
public:
  static constexpr double CREEP = 500e-6;       ///< of a period; crystals are off by 100e-6 at most
  static constexpr double SETTLING_S = 0.5;     ///< first samples, which only make the line [s]
  static constexpr double WINDOW_S = 0.25;      ///< all arrivals of it are late: samples were lost [s]
  static constexpr double LONGEST_GAP_S = 1.0;  ///< without arrivals, beyond which the clock begins anew [s]

  /// @param rate  of the device, positive [Hz].
  explicit SampleClock(double rate);

  /// A sample came. @param arrival_ns  not before that of the sample before.
  /// @return its time, greater than that of the sample before; nullopt while the clock settles.
  std::optional<int64_t> sample(int64_t arrival_ns);
  /// A sample came that cannot be read.
  void skip();
  void restart();
  /// Samples of which nothing came.
  uint64_t missed() const { return missed_; }

private:
  const int64_t period_ns_;
  const int64_t settling_;  ///< samples
  const int64_t window_;    ///< samples
  int64_t expected_ns_ = 0;
  int64_t arrival_ns_ = 0;
  int64_t stamp_ns_ = 0;
  int64_t samples_ = 0;   ///< since the clock began; 0: it has not
  int64_t least_ns_ = 0;  ///< delay in the window
  uint64_t missed_ = 0;
};

}  // namespace pi_vehicle
