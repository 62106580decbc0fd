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

/// How long it takes until one computing unit has the result of another: latency + bytes / bandwidth, per ordered pair
/// of units. Inside a unit it takes no time, nor between units with the same memory (latency 0, bandwidth infinite).
/// An edge without bytes still takes the latency, as the other unit has to be told.
///
/// Reading is safe from any number of threads while nobody changes it.
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

  /// The mean of time() over all ordered pairs of different units is latency + bytes * seconds_per_byte; 0 with less
  /// than two units. (The mean of 1 / bandwidth, not one over the mean: it is exact, and finite for shared memory.)
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
