#include "policies/estimates.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace pi_offload
{
namespace
{
/// Least part of the network's time for the transfer; the subtracted round trip is only an estimate.
constexpr double LEAST_TRANSFER_SHARE = 0.1;
/// A usual rate below the first one counts half after this multiple of Options::memory_s.
constexpr double USUAL_MEMORIES = 15.0;
/// Squares of the map of usual rates [m], and most of them.
constexpr double PLACE_M = 10.0;
constexpr size_t MOST_PLACES = 4096;
/// The usual rate of all places counts as so many samples of a place.
constexpr double SAMPLES_ELSEWHERE = 4.0;
/// Longer times of a node are cut to this [s].
constexpr double LONGEST_S = 3600.0;

bool usable(double value)
{
  return std::isfinite(value) && value >= 0.0;
}

double bounded(double value)
{
  return std::isnan(value) ? 0.0 : std::clamp(value, 0.0, LONGEST_S);
}
}  // namespace

MeanDeviation::MeanDeviation(double mean_gain, double deviation_gain)
  : mean_gain_(mean_gain), deviation_gain_(deviation_gain)
{
  const pi_node::OptionCheck check("estimates");
  check.positive("mean_gain", mean_gain);
  check.range("mean_gain", mean_gain, 0.0, 1.0);
  check.positive("deviation_gain", deviation_gain);
  check.range("deviation_gain", deviation_gain, 0.0, 1.0);
}

void MeanDeviation::add(double sample)
{
  if (!std::isfinite(sample))
  {
    return;
  }
  if (!known_)
  {
    known_ = true;
    mean_ = sample;
    deviation_ = 0.5 * std::abs(sample);
    return;
  }
  // RFC 6298, 2.3: the deviation is taken from the mean before it moves.
  deviation_ += deviation_gain_ * (std::abs(sample - mean_) - deviation_);
  mean_ += mean_gain_ * (sample - mean_);
}

void MeanDeviation::reset()
{
  known_ = false;
  mean_ = 0.0;
  deviation_ = 0.0;
}

void RecentMedian::add(double sample)
{
  if (!std::isfinite(sample))
  {
    return;
  }
  samples_[count_ % WINDOW] = sample;
  count_ = count_ + 1 < 2 * WINDOW ? count_ + 1 : WINDOW;
  const auto used = static_cast<std::ptrdiff_t>(std::min(count_, WINDOW));
  std::array<double, WINDOW> sorted = samples_;
  const auto middle = sorted.begin() + (used - 1) / 2;
  std::nth_element(sorted.begin(), middle, sorted.begin() + used);
  median_ = *middle;
  for (auto one = sorted.begin(); one != sorted.begin() + used; ++one)
  {
    *one = std::abs(*one - median_);
  }
  const std::ptrdiff_t usual = used - used / 5;
  std::nth_element(sorted.begin(), sorted.begin() + usual - 1, sorted.begin() + used);
  const double sum = std::accumulate(sorted.begin(), sorted.begin() + usual, 0.0);
  // With few samples half of the median counts as one more.
  deviation_ = (sum + (count_ < WINDOW ? 0.5 * std::abs(median_) : 0.0)) /
               static_cast<double>(usual + (count_ < WINDOW && used > 1 ? 1 : 0));
}

void NodeEstimates::Options::validate() const
{
  const pi_node::OptionCheck check("estimates");
  check.range("least_rate_mbps", least_rate_mbps, 1e-6, 1e6);
  check.range("first_rate_mbps", first_rate_mbps, least_rate_mbps, 1e6);
  check.range("first_round_trip_s", first_round_trip_s, 0.0, 10.0);
  check.range("probe_bytes", probe_bytes, size_t{0}, size_t{1} << 20U);
  check.range("memory_s", memory_s, 0.01, 3600.0);
}

NodeEstimates::NodeEstimates(const Options& options) : options_(options)
{
  options_.validate();
}

void NodeEstimates::add(const RequestTiming& timing, int64_t now_ns)
{
  if (!usable(timing.total_s) || !usable(timing.queue_s) || !usable(timing.service_s))
  {
    return;
  }
  unanswered_s_ = 0.0;
  const size_t kind = static_cast<size_t>(timing.kind);
  service_[kind].add(std::min(timing.service_s, timing.total_s));
  queue_[kind].add(std::min(timing.queue_s, timing.total_s));
  const double network_s = timing.total_s - timing.queue_s - timing.service_s;
  if (network_s < 0.0)
  {
    return;  // the node reports more than passed here
  }
  const double megabits = static_cast<double>(timing.input_bytes + timing.output_bytes) * MBIT_PER_BYTE;
  addNetwork(network_s, megabits, timing.input_bytes <= options_.probe_bytes, now_ns);
}

void NodeEstimates::addNetwork(double network_s, double megabits, bool small, int64_t now_ns)
{
  if (small)
  {
    round_trip_.add(network_s);
    return;
  }
  const double round_trip_s = round_trip_.known() ? round_trip_.mean() : options_.first_round_trip_s;
  const double transfer_s = std::max(network_s - round_trip_s, LEAST_TRANSFER_SHARE * network_s);
  const double sample = std::min(transfer_s / megabits, 1.0 / options_.least_rate_mbps);
  seconds_per_mbit_.add(sample);
  usual_seconds_per_mbit_.add(sample);
  if (places_.size() < MOST_PLACES || places_.count(place_) != 0)
  {
    Place& place = places_[place_];
    place.seconds_per_mbit.add(sample);
    place.samples += 1.0;
  }
  rate_ns_ = now_ns;
}

void NodeEstimates::addRoundTrip(double round_trip_s, int64_t /*now_ns*/)
{
  if (!usable(round_trip_s))
  {
    return;
  }
  unanswered_s_ = 0.0;
  round_trip_.add(round_trip_s);
}

void NodeEstimates::addTimeout(TaskKind kind, size_t input_bytes, double waited_s, int64_t now_ns)
{
  if (!usable(waited_s))
  {
    return;
  }
  const size_t k = static_cast<size_t>(kind);
  const double network_s = waited_s - service_[k].mean() - queue_[k].mean();
  const double megabits = static_cast<double>(input_bytes) * MBIT_PER_BYTE;
  if (network_s <= network(megabits, 0.0, now_ns).mean_s)
  {
    return;  // not slower than expected
  }
  unanswered_s_ = network_s;
  // A lower bound of the time: it can only raise the estimate.
  addNetwork(network_s, megabits, input_bytes <= options_.probe_bytes, now_ns);
}

void NodeEstimates::setAdvertisement(const NodeAdvertisement& advertisement, int64_t now_ns)
{
  advertisement_ = advertisement;
  for (NodeAdvertisement::OfKind& of_kind : advertisement_.of_kind)
  {
    of_kind.service_s = bounded(of_kind.service_s);
    of_kind.service_deviation_s = bounded(of_kind.service_deviation_s);
    of_kind.queue_s = bounded(of_kind.queue_s);
    of_kind.lease_until_s = bounded(of_kind.lease_until_s);
    of_kind.lease_rate_hz = usable(of_kind.lease_rate_hz) ? of_kind.lease_rate_hz : 0.0;
  }
  advertisement_.capacity_gcycles = usable(advertisement.capacity_gcycles) ? advertisement.capacity_gcycles : 0.0;
  advertisement_.has_position = advertisement.has_position && std::isfinite(advertisement.position.x) &&
                                std::isfinite(advertisement.position.y) && advertisement.range_m >= 0.0;
  advertised_ = true;
  advertised_ns_ = now_ns;
}

void NodeEstimates::setPlace(const Point& position)
{
  const auto square = [](double at)
  { return static_cast<uint32_t>(static_cast<int32_t>(std::clamp(at / PLACE_M, -1e9, 1e9))); };
  place_ = (static_cast<uint64_t>(square(position.x)) << 32U) | square(position.y);
}

void NodeEstimates::forgetNetwork()
{
  round_trip_.reset();
  seconds_per_mbit_.reset();
  unanswered_s_ = 0.0;
}

double NodeEstimates::advertisementAge(int64_t now_ns) const
{
  if (!advertised_)
  {
    return std::numeric_limits<double>::infinity();
  }
  return std::max(0.0, pi_node::seconds(now_ns - advertised_ns_));
}

double NodeEstimates::weight(int64_t now_ns, double memory_s) const
{
  const double ages = std::max(0.0, pi_node::seconds(now_ns - rate_ns_)) / memory_s;
  return 1.0 / (1.0 + ages * ages);
}

NetworkTime NodeEstimates::perMbit(int64_t now_ns) const
{
  const double first = 1.0 / options_.first_rate_mbps;
  const bool has_usual = usual_seconds_per_mbit_.known();
  double usual = has_usual ? usual_seconds_per_mbit_.mean() : first;
  double usual_deviation = has_usual ? usual_seconds_per_mbit_.deviation() : 0.5 * first;
  const auto place = places_.find(place_);
  if (place != places_.end())
  {
    const double here = place->second.samples / (place->second.samples + SAMPLES_ELSEWHERE);
    usual += here * (place->second.seconds_per_mbit.mean() - usual);
    usual_deviation += here * (place->second.seconds_per_mbit.deviation() - usual_deviation);
  }
  if (usual > first)
  {
    // Otherwise a node that was slow once is never tried again.
    const double share = weight(now_ns, USUAL_MEMORIES * options_.memory_s);
    usual = share * usual + (1.0 - share) * first;
    usual_deviation = share * usual_deviation + (1.0 - share) * 0.5 * first;
  }
  if (!seconds_per_mbit_.known())
  {
    return {usual, usual_deviation};
  }
  const double share = weight(now_ns, options_.memory_s);
  return {share * seconds_per_mbit_.mean() + (1.0 - share) * usual,
          share * seconds_per_mbit_.deviation() + (1.0 - share) * usual_deviation};
}

double NodeEstimates::rateAge(int64_t now_ns) const
{
  return seconds_per_mbit_.known() ? std::max(0.0, pi_node::seconds(now_ns - rate_ns_))
                                   : std::numeric_limits<double>::infinity();
}

double NodeEstimates::rate(int64_t now_ns) const
{
  const double seconds = perMbit(now_ns).mean_s;
  return seconds > 0.0 ? 1.0 / seconds : std::numeric_limits<double>::infinity();
}

NetworkTime NodeEstimates::network(double input_mbit, double output_mbit, int64_t now_ns) const
{
  const bool known = round_trip_.known();
  const double round_trip_s = known ? round_trip_.mean() : options_.first_round_trip_s;
  const double round_trip_deviation_s = known ? round_trip_.deviation() : 0.5 * options_.first_round_trip_s;
  const NetworkTime per_mbit = perMbit(now_ns);
  const double megabits = input_mbit + output_mbit;
  const double transfer_deviation_s = megabits * per_mbit.deviation_s;
  NetworkTime time;
  time.mean_s = std::max(round_trip_s + megabits * per_mbit.mean_s, unanswered_s_);
  time.deviation_s =
      std::sqrt(round_trip_deviation_s * round_trip_deviation_s + transfer_deviation_s * transfer_deviation_s);
  return time;
}

}  // namespace pi_offload
