#include "power/battery_estimator.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle::power
{

constexpr double LEAST_DRAW_W = 0.01;  ///< less draws no computer; guards the division

void BatteryOptions::validate() const
{
  const pi_node::OptionCheck check("battery");
  check.range("capacity_ah", capacity_ah, 0.01, 10000.0);
  check.range("nominal_voltage", nominal_voltage, 0.1, 1000.0);
  check.range("smoothing_s", smoothing_s, 0.1, 3600.0);
  check.range("low_charge", low_charge, 0.0, 1.0);
  check.range("empty_charge", empty_charge, 0.0, low_charge);
  check.range("low_remaining_s", low_remaining_s, 0.0, 1e6);
}

BatteryEstimator::BatteryEstimator(const BatteryOptions& options) : options_(options)
{
  options_.validate();
}

BatteryEstimate BatteryEstimator::update(int64_t now_ns, const BatteryReading& reading, double computer_w)
{
  const double of_battery_w = -reading.voltage * reading.current;
  const bool of_battery = std::isfinite(of_battery_w);
  const double draw_w = of_battery ? of_battery_w : computer_w;
  if (std::isfinite(draw_w))
  {
    const double age_s = 1e-9 * static_cast<double>(now_ns - updated_ns_);
    const bool again = !std::isfinite(draw_w_) || of_battery != of_battery_;
    const double part = again ? 1.0 : 1.0 - std::exp(-std::max(age_s, 0.0) / options_.smoothing_s);
    draw_w_ = again ? draw_w : draw_w_ + part * (draw_w - draw_w_);
    of_battery_ = of_battery;
    updated_ns_ = now_ns;
  }
  BatteryEstimate estimate;
  estimate.draw_w = draw_w_;
  if (std::isfinite(reading.charge) && std::isfinite(draw_w_) && draw_w_ >= LEAST_DRAW_W)
  {
    const double charge = std::clamp(reading.charge, 0.0, 1.0);
    estimate.remaining_s = 3600.0 * charge * options_.capacity_ah * options_.nominal_voltage / draw_w_;
  }
  return estimate;
}

}  // namespace pi_vehicle::power
