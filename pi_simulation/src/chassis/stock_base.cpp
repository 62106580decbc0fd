#include "chassis/stock_base.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_simulation
{

using namespace pi_vehicle::chassis;

namespace
{

constexpr double BASE_STANDING = 0.02;  ///< [m/s], [rad/s] slower counts as standing

}  // namespace

StockBase::StockBase(const StockBaseOptions& options, int64_t now_ns) : options_(options), update_ns_(now_ns) {}

bool StockBase::onTwist(double linear, double angular, int64_t now_ns)
{
  ++twists_;
  if (!std::isfinite(linear) || !std::isfinite(angular))
  {
    return false;
  }
  linear_ = linear;
  angular_ = angular;
  twist_ns_ = now_ns;
  holds_ = true;
  ran_out_ = false;
  return true;
}

Setpoint StockBase::update(const Measurement& measured, int64_t now_ns)
{
  const double dt = std::max(0.0, pi_node::secondsBetween(std::exchange(update_ns_, now_ns), now_ns));
  if (std::exchange(counted_, true))
  {
    odometry_ = odometry_.turned((1.0 + options_.distance_error) * (measured.travel - travel_),
                                 (1.0 + options_.turn_error) * (measured.turn - turn_));
  }
  travel_ = measured.travel;
  turn_ = measured.turn;

  ran_out_ = ran_out_ || (holds_ && pi_node::secondsBetween(twist_ns_, now_ns) > options_.timeout_s);
  holds_ = holds_ && !ran_out_;
  const bool button = (measured.faults & EMERGENCY_BUTTON) != 0;
  const bool fault = (measured.faults & ~(WARNING_FAULTS | EMERGENCY_BUTTON)) != 0;
  const bool drives = holds_ && !button && !fault;
  const Limits& limits = options_.limits;
  const double speed = drives ? std::clamp(linear_, -limits.reverse_speed, limits.speed) : 0.0;
  setpoint_.speed = rampSpeed(setpoint_.speed, speed, limits.acceleration, limits.deceleration, dt);
  if (options_.kind == Kind::DIFFERENTIAL)
  {
    const double yaw_rate = drives ? std::clamp(angular_, -options_.yaw_rate, options_.yaw_rate) : 0.0;
    const double rate = options_.angular_acceleration;
    setpoint_.yaw_rate = rampSpeed(setpoint_.yaw_rate.value_or(0.0), yaw_rate, rate, rate, dt);
  }
  else if (drives && std::abs(linear_) > BASE_STANDING)
  {
    setpoint_.curvature = std::clamp(angular_ / linear_, -limits.curvature, limits.curvature);
  }
  const bool moves = std::abs(setpoint_.speed) > 0.0 || std::abs(measured.speed) >= BASE_STANDING ||
                     std::abs(measured.yaw_rate) >= BASE_STANDING;
  mode_ = button     ? Mode::EMERGENCY_STOP
          : fault    ? Mode::FAULT
          : ran_out_ ? Mode::STOPPED_WATCHDOG
          : moves    ? Mode::DRIVING
                     : Mode::READY;
  return setpoint_;
}

}  // namespace pi_simulation
