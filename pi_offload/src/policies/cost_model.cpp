#include "policies/cost_model.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_offload
{

namespace
{

constexpr double UNREACHABLE = std::numeric_limits<double>::infinity();
constexpr double MOST_WATTS = 1e4;
constexpr double MOST_GHZ = 1e3;

/// No data takes no time at any rate.
double transferTime(double mbit, double mbps)
{
  if (!(mbit > 0.0))
  {
    return 0.0;
  }
  return mbps > 0.0 ? mbit / mbps : UNREACHABLE;
}

}  // namespace

void LocalComputer::validate() const
{
  const pi_node::OptionCheck check("computer");
  check.positive("frequency_ghz", frequency_ghz);
  check.range("frequency_ghz", frequency_ghz, 0.0, MOST_GHZ);
  check.positive("least_frequency_ghz", least_frequency_ghz);
  check.range("least_frequency_ghz", least_frequency_ghz, 0.0, frequency_ghz);
  check.range("static_w", static_w, 0.0, MOST_WATTS);
  check.range("beta_w_per_ghz3", beta_w_per_ghz3, 0.0, MOST_WATTS);
}

void Radio::validate() const
{
  const pi_node::OptionCheck check("radio");
  check.range("transmit_w", transmit_w, 0.0, MOST_WATTS);
  check.range("receive_w", receive_w, 0.0, MOST_WATTS);
  check.range("wait_w", wait_w, 0.0, MOST_WATTS);
  check.range("tail_w", tail_w, 0.0, MOST_WATTS);
  check.range("tail_s", tail_s, 0.0, 3600.0);
}

Cost localCost(const TaskNeeds& needs, const LocalComputer& computer)
{
  return localCost(needs, computer, computer.frequency_ghz);
}

Cost localCost(const TaskNeeds& needs, const LocalComputer& computer, double frequency_ghz)
{
  if (!(frequency_ghz > 0.0 && std::isfinite(frequency_ghz)))
  {
    throw std::invalid_argument("frequency_ghz = " + std::to_string(frequency_ghz) + ", must be positive");
  }
  const double f = frequency_ghz;
  Cost cost;
  cost.time_s = needs.work_gcycles / f;                                                                 // eq. 3
  cost.energy_j = (computer.static_w + computer.beta_w_per_ghz3 * f * f * f) * needs.work_gcycles / f;  // eq. 4
  return cost;
}

Cost remoteCost(const TaskNeeds& needs, const Radio& radio, const RemoteService& service)
{
  const double up_s = transferTime(needs.input_mbit, service.uplink_mbps);
  const double down_s = transferTime(needs.output_mbit, service.downlink_mbps);
  const double work_s = transferTime(needs.work_gcycles, service.frequency_ghz);
  const double waiting_s = work_s + service.queue_s + service.round_trip_s;
  Cost cost;
  cost.time_s = up_s + down_s + waiting_s;  // eq. 5
  if (!std::isfinite(cost.time_s))
  {
    cost.energy_j = UNREACHABLE;
    return cost;
  }
  cost.energy_j = radio.transmit_w * up_s + radio.receive_w * down_s;  // eq. 6
  cost.energy_j += radio.wait_w * waiting_s + radio.tail_w * radio.tail_s;
  return cost;
}

double printedCost(const Cost& cost, double eta)
{
  return eta * cost.time_s + (1.0 - eta) * cost.energy_j;
}

double normalisedCost(const Cost& cost, double deadline_s, double local_energy_j, double eta)
{
  return eta * cost.time_s / deadline_s + (1.0 - eta) * cost.energy_j / local_energy_j;
}

double mostEfficientFrequency(const LocalComputer& computer)
{
  return std::cbrt(computer.static_w / (2.0 * computer.beta_w_per_ghz3));
}

double bestLocalFrequency(const TaskNeeds& needs, const LocalComputer& computer)
{
  const double needed = needs.deadline_s > 0.0 ? needs.work_gcycles / needs.deadline_s : UNREACHABLE;
  // Without dynamic power the highest frequency is the most efficient.
  const double efficient = computer.beta_w_per_ghz3 > 0.0 ? mostEfficientFrequency(computer) : UNREACHABLE;
  return std::clamp(std::max(efficient, needed), computer.least_frequency_ghz, computer.frequency_ghz);
}

}  // namespace pi_offload
