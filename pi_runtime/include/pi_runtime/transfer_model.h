#pragma once

#include <cstddef>
#include <limits>
#include <vector>

namespace pi_runtime
{

/// The way from one computing unit to another.
struct TransferLink
{
  double latency = 0.0;                                        ///< [s], finite and >= 0
  double bandwidth = std::numeric_limits<double>::infinity();  ///< [B/s], > 0; infinite: both share one memory
};

/// Time until one computing unit has the result of another: latency + bytes / bandwidth, per ordered pair of units. 0
/// inside a unit and between units with the same memory. An edge without bytes takes the latency of the notification.
/// Any number of threads may read while none writes.
class TransferModel
{
public:
  /// Every pair of different units gets the same link; by default all units share one memory.
  /// @throws std::invalid_argument  impossible latency or bandwidth.
  explicit TransferModel(std::size_t units, TransferLink link = TransferLink());

  /// Describes the way from one unit to another; the way back is a link of its own.
  /// @throws std::invalid_argument  from = to, unknown unit, impossible latency or bandwidth.
  void setLink(std::size_t from, std::size_t to, TransferLink link);

  std::size_t units() const { return units_; }

  /// @return [s]; units are not checked.
  double time(std::size_t from, std::size_t to, double bytes) const
  {
    const std::size_t i = from * units_ + to;
    return latency_[i] + bytes * seconds_per_byte_[i];
  }

  /// Mean of time() over all ordered pairs of different units: latency + bytes * seconds_per_byte; 0 with one unit.
  struct Mean
  {
    double latency = 0.0;           ///< [s]
    double seconds_per_byte = 0.0;  ///< [s/B]
    double time(double bytes) const { return latency + bytes * seconds_per_byte; }
  };
  Mean mean() const;

private:
  std::size_t units_;
  std::vector<double> latency_;           // units x units, by row; 0 on the diagonal
  std::vector<double> seconds_per_byte_;  // the same
};

}  // namespace pi_runtime
