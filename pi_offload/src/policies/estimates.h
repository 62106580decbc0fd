#pragma once

#include <array>
#include <unordered_map>

#include "engine/node.h"

namespace pi_offload
{

constexpr double MBIT_PER_BYTE = 8e-6;

/// Exponentially weighted mean and mean deviation as TCP estimates round trips (RFC 6298: gains 1/8 and 1/4). The first
/// sample sets the mean, and half of it as the deviation.
class MeanDeviation
{
public:
  /// @param mean_gain, deviation_gain  in (0, 1], else std::invalid_argument.
  explicit MeanDeviation(double mean_gain = 0.125, double deviation_gain = 0.25);
  /// A sample that is not finite is ignored.
  void add(double sample);
  void reset();
  bool known() const { return known_; }
  double mean() const { return mean_; }            ///< 0 if unknown
  double deviation() const { return deviation_; }  ///< 0 if unknown

private:
  double mean_gain_;
  double deviation_gain_;
  bool known_ = false;
  double mean_ = 0.0;
  double deviation_ = 0.0;
};

/// Median of the last samples, and their mean absolute deviation from it without the largest fifth: a few very long
/// times move neither. The first samples count as MeanDeviation's.
class RecentMedian
{
public:
  /// A sample that is not finite is ignored.
  void add(double sample);
  void reset() { count_ = 0; }
  bool known() const { return count_ > 0; }
  double mean() const { return median_; }          ///< 0 if unknown
  double deviation() const { return deviation_; }  ///< 0 if unknown

private:
  static constexpr size_t WINDOW = 15;

  std::array<double, WINDOW> samples_{};
  size_t count_ = 0;
  double median_ = 0.0;
  double deviation_ = 0.0;
};

/// One finished request, as the vehicle and the node measured it.
struct RequestTiming
{
  TaskKind kind = TaskKind::DETECTION;
  size_t input_bytes = 0;
  size_t output_bytes = 0;
  double total_s = 0.0;    ///< sent to received, by the vehicle's clock
  double queue_s = 0.0;    ///< in the node's queue, by the node's clock
  double service_s = 0.0;  ///< on the worker, by the node's clock
};

/// Expected time of the network for a request and its reply [s].
struct NetworkTime
{
  double mean_s = 0.0;
  double deviation_s = 0.0;  ///< mean absolute deviation
};

/// Learns from a node's replies: rate and round trip of the network, service time and queue per kind of task.
///
/// The network's time is total - queue - service. A small request (a probe) gives the round trip; a large one, less the
/// round trip, gives the rate of both directions. Times reported by the node are cut at the total. Numbers that are
/// negative or not finite are ignored. Not thread safe. Allocates only for new places, at most 4096.
class NodeEstimates
{
public:
  struct Options
  {
    double least_rate_mbps = 0.05;  ///< least estimate of the rate
    double first_rate_mbps = 10.0;  ///< until one is measured
    double first_round_trip_s = 0.02;
    size_t probe_bytes = 4096;  ///< requests up to this size give the round trip
    /// A rate of this age counts half; the node's usual rate (at first: first_rate_mbps) counts the other half.
    /// Otherwise a node with a bad rate gets no tasks, is not measured, and is never tried again. A usual rate below
    /// first_rate_mbps returns to it in the same way, 15 times slower.
    double memory_s = 2.0;

    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  NodeEstimates() : NodeEstimates(Options()) {}
  explicit NodeEstimates(const Options& options);

  void add(const RequestTiming& timing, int64_t now_ns);
  /// Adds the answer to a probe.
  void addRoundTrip(double round_trip_s, int64_t now_ns);
  /// A request had no answer after waited_s. Until the next answer network() is at least this time, less the node's own
  /// time.
  void addTimeout(TaskKind kind, size_t input_bytes, double waited_s, int64_t now_ns);
  void setAdvertisement(const NodeAdvertisement& advertisement, int64_t now_ns);
  /// The vehicle's position. The usual rate is learned by place, in squares of 10 m: round by round.
  void setPlace(const Point& position);
  /// Forgets rate and round trip, but not the usual rate. For a new connection, or a vehicle that was out of range.
  void forgetNetwork();

  /// For a request and its reply, both at the same rate.
  NetworkTime network(double input_mbit, double output_mbit, int64_t now_ns) const;
  double rateAge(int64_t now_ns) const;  ///< [s]; infinite without a measurement
  /// Expected rate [Mbit/s], see Options::memory_s.
  double rate(int64_t now_ns) const;

  bool hasAdvertisement() const { return advertised_; }
  const NodeAdvertisement& advertisement() const { return advertisement_; }
  double advertisementAge(int64_t now_ns) const;                             ///< [s]; infinite without one
  const MeanDeviation& roundTrip() const { return round_trip_; }             ///< [s]
  const MeanDeviation& secondsPerMbit() const { return seconds_per_mbit_; }  ///< of the uplink [s/Mbit]
  const RecentMedian& service(TaskKind kind) const { return service_[static_cast<size_t>(kind)]; }  ///< [s]
  const MeanDeviation& queue(TaskKind kind) const { return queue_[static_cast<size_t>(kind)]; }     ///< [s]

private:
  /// Weight of a measurement by its age: a half after memory_s.
  double weight(int64_t now_ns, double memory_s) const;
  /// Seconds per megabit, mean and deviation.
  NetworkTime perMbit(int64_t now_ns) const;
  void addNetwork(double network_s, double megabits, bool small, int64_t now_ns);

  Options options_;
  NodeAdvertisement advertisement_;
  bool advertised_ = false;
  int64_t advertised_ns_ = 0;
  int64_t rate_ns_ = 0;      ///< of the last sample
  double unanswered_s_ = 0;  ///< least time of the network, by requests without an answer since the last answer
  MeanDeviation round_trip_;
  /// Fading changes within few samples with little noise; a gain of 1/8 would lag by a second.
  MeanDeviation seconds_per_mbit_{0.5, 0.25};
  MeanDeviation usual_seconds_per_mbit_{1.0 / 64.0, 1.0 / 64.0};
  /// The same of a place.
  struct Place
  {
    MeanDeviation seconds_per_mbit{0.125, 0.125};
    double samples = 0.0;
  };
  std::unordered_map<uint64_t, Place> places_;
  uint64_t place_ = 0;
  std::array<RecentMedian, TASK_KINDS> service_;
  std::array<MeanDeviation, TASK_KINDS> queue_;
};

}  // namespace pi_offload
