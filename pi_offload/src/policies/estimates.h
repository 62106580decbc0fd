#pragma once

#include "engine/node.h"

namespace pi_offload
{

/// Exponentially weighted mean and mean deviation, as TCP estimates round trips (RFC 6298: gains 1/8 and 1/4); the
/// first sample sets the mean, and half of it as deviation.
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

/// What the network needs for a request and its reply, as far as it is known [s].
struct NetworkTime
{
  double mean_s = 0.0;
  double deviation_s = 0.0;  ///< mean absolute deviation
};

/// What is learned of a node from its replies: rate and round trip of the network, service time and queue per kind of
/// task. Not thread safe; allocates nothing.
///
/// The network's time of a request is total - queue - service; a small one (a probe) teaches the round trip, a large
/// one, less the round trip, the rate (of both directions together). What a node says of its own time is believed only
/// as far as it fits into the total. Numbers that are not finite or negative are ignored.
class NodeEstimates
{
public:
  struct Options
  {
    double least_rate_mbps = 0.05;  ///< a rate is not estimated below this
    double first_rate_mbps = 10.0;  ///< until one is measured
    double first_round_trip_s = 0.02;
    size_t probe_bytes = 4096;  ///< requests up to this size teach the round trip
    /// A rate measured so long ago counts half, the node's usual one (at first: the first rate) the other half: after a
    /// bad stretch nothing is sent and so nothing measured, and the node would never be tried again. A usual rate below
    /// the first one returns to that in the same way, 15 times slower.
    double memory_s = 2.0;

    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  NodeEstimates() : NodeEstimates(Options()) {}
  explicit NodeEstimates(const Options& options);

  void add(const RequestTiming& timing, int64_t now_ns);
  /// A probe's answer: @param round_trip_s  of an empty message.
  void addRoundTrip(double round_trip_s, int64_t now_ns);
  /// A request was not answered after so long: the network or the node is at least that slow. Until the next answer
  /// network() is at least what of this time the node itself does not need.
  void addTimeout(TaskKind kind, size_t input_bytes, double waited_s, int64_t now_ns);
  void setAdvertisement(const NodeAdvertisement& advertisement, int64_t now_ns);
  /// Forgets rate and round trip, but not the usual rate: after the vehicle was out of range, or the connection is a
  /// new one.
  void forgetNetwork();

  /// Of a request and reply of so many megabits, both at the same rate.
  NetworkTime network(double input_mbit, double output_mbit, int64_t now_ns) const;
  double rateAge(int64_t now_ns) const;  ///< since it was measured last [s], infinite without one
  /// Rate that is expected [Mbit/s]; between the measured, the usual, and the first one, see Options::memory_s.
  double rate(int64_t now_ns) const;

  bool hasAdvertisement() const { return advertised_; }
  const NodeAdvertisement& advertisement() const { return advertisement_; }
  double advertisementAge(int64_t now_ns) const;                             ///< [s], infinite without one
  const MeanDeviation& roundTrip() const { return round_trip_; }             ///< [s]
  const MeanDeviation& secondsPerMbit() const { return seconds_per_mbit_; }  ///< of the uplink [s/Mbit]
  const MeanDeviation& service(TaskKind kind) const { return service_[static_cast<size_t>(kind)]; }  ///< [s]
  const MeanDeviation& queue(TaskKind kind) const { return queue_[static_cast<size_t>(kind)]; }      ///< [s]

private:
  /// Share of what was measured, as it ages: a half after memory_s.
  double weight(int64_t now_ns, double memory_s) const;
  /// Seconds per megabit, mean and deviation.
  NetworkTime perMbit(int64_t now_ns) const;
  void addNetwork(double network_s, double megabits, bool small, int64_t now_ns);

  Options options_;
  NodeAdvertisement advertisement_;
  bool advertised_ = false;
  int64_t advertised_ns_ = 0;
  int64_t rate_ns_ = 0;      ///< of the last sample of the rate
  double unanswered_s_ = 0;  ///< least time of the network by requests without an answer, since the last answer
  MeanDeviation round_trip_;
  /// Fading changes within few samples, which are hardly noisier than it: a gain of 1/8 would follow a second behind.
  MeanDeviation seconds_per_mbit_{0.5, 0.25};
  MeanDeviation usual_seconds_per_mbit_{1.0 / 64.0, 1.0 / 64.0};
  std::array<MeanDeviation, TASK_KINDS> service_;
  std::array<MeanDeviation, TASK_KINDS> queue_;
};

}  // namespace pi_offload
