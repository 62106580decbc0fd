#include "chassis/chassis_model.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_simulation
{
namespace
{

constexpr double SUBSTEP_S = 1e-3;
constexpr double GRAVITY = 9.81;
constexpr double STICTION_SPEED = 0.003;  ///< [m/s] slower, and asked to stand, the vehicle stands

}  // namespace

void ModelOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("wheelbase", wheelbase, 0.05, 20.0);
  check.range("max_steering", max_steering, 0.01, 1.5);
  check.range("max_steering_rate", max_steering_rate, 0.01, 100.0);
  check.range("speed_lag_s", speed_lag_s, 0.0, 5.0);
  check.range("steering_lag_s", steering_lag_s, 0.0, 5.0);
  check.range("dead_time_s", dead_time_s, 0.0, 2.0);
  check.range("mass", mass, 1.0, 1e5);
  check.range("rolling_resistance", rolling_resistance, 0.0, 1.0);
  check.range("efficiency", efficiency, 0.05, 1.0);
  check.range("idle_power", idle_power, 0.0, 1e5);
  check.range("battery_capacity", battery_capacity, 0.01, 1e5);
  check.range("battery_empty_voltage", battery_empty_voltage, 1.0, 60.0);
  check.range("battery_full_voltage", battery_full_voltage, battery_empty_voltage, 60.0);
  check.range("battery_resistance", battery_resistance, 0.0, 10.0);
  check.range("battery_charge", battery_charge, 0.0, 1.0);
  check.range("battery_low", battery_low, 0.0, 1.0);
}

ChassisModel::ChassisModel(const ModelOptions& options)
  : options_(options), charge_(options.battery_charge), voltage_(options.battery_full_voltage)
{
  options_.validate();
  discharge(0.0, 0.0);
}

void ChassisModel::setBatteryCharge(double charge)
{
  charge_ = std::clamp(charge, 0.0, 1.0);
}

void ChassisModel::step(const Setpoint& setpoint, double dt)
{
  waiting_.push_back({time_ + options_.dead_time_s, setpoint});
  const double whole = std::clamp(dt, 0.0, 1.0);
  const int steps = static_cast<int>(std::ceil(whole / SUBSTEP_S));
  for (int i = 0; i < steps; ++i)
  {
    substep(whole / steps);
  }
}

void ChassisModel::setSlip(double share)
{
  slip_ = std::clamp(share, 0.0, 1.0);
}

void ChassisModel::substep(double dt)
{
  while (!waiting_.empty() && waiting_.front().due <= time_ + 1e-9)
  {
    effective_ = waiting_.front().setpoint;
    waiting_.pop_front();
  }
  time_ += dt;

  const double speed_before = speed_;
  const double yaw_rate_before = yaw_rate_;
  const double drive_share = options_.speed_lag_s > 0.0 ? 1.0 - std::exp(-dt / options_.speed_lag_s) : 1.0;
  if (stuck_)
  {
    speed_ = 0.0;
  }
  else
  {
    speed_ += drive_share * (effective_.speed - speed_);
    if (effective_.speed == 0.0 && std::abs(speed_) < STICTION_SPEED)
    {
      speed_ = 0.0;
    }
  }

  const double share = options_.steering_lag_s > 0.0 ? 1.0 - std::exp(-dt / options_.steering_lag_s) : 1.0;
  const double curvature_before = curvature_;
  if (options_.kind == chassis::Kind::CAR_LIKE)
  {
    const double wanted =
        std::clamp(std::atan(effective_.curvature * options_.wheelbase), -options_.max_steering, options_.max_steering);
    const double most = options_.max_steering_rate * dt;
    steering_ += std::clamp(share * (wanted - steering_), -most, most);
    curvature_ = std::tan(steering_) / options_.wheelbase;
  }
  else if (effective_.yaw_rate)
  {
    yaw_rate_ = stuck_ ? 0.0 : yaw_rate_ + drive_share * (*effective_.yaw_rate - yaw_rate_);
    curvature_ = speed_ != 0.0 ? yaw_rate_ / speed_ : 0.0;
  }
  else
  {
    curvature_ += share * (effective_.curvature - curvature_);
  }

  const double distance = 0.5 * (speed_before + speed_) * dt;
  double turn = 0.5 * (yaw_rate_before + yaw_rate_) * dt;
  if (!effective_.yaw_rate)
  {
    turn = 0.5 * (curvature_before + curvature_) * distance;
    yaw_rate_ = speed_ * curvature_;
  }
  pose_ = pose_.turned((1.0 - slip_) * distance, (1.0 - slip_) * turn);
  travel_ += distance;
  turn_ += turn;
  discharge(dt > 0.0 && !stuck_ ? (speed_ - speed_before) / dt : 0.0, dt);
}

/// P = U I - R I^2 gives the current; what braking gives back is lost.
void ChassisModel::discharge(double acceleration, double dt)
{
  const double force = options_.mass * (acceleration * (speed_ < 0.0 ? -1.0 : 1.0) +
                                        (speed_ != 0.0 ? options_.rolling_resistance * GRAVITY : 0.0));
  const double power = options_.idle_power + std::max(0.0, force * std::abs(speed_)) / options_.efficiency;
  const double open =
      options_.battery_empty_voltage + charge_ * (options_.battery_full_voltage - options_.battery_empty_voltage);
  const double r = options_.battery_resistance;
  const double root = open * open - 4.0 * r * power;
  const double current = r > 0.0 ? (open - std::sqrt(std::max(0.0, root))) / (2.0 * r) : power / open;
  charge_ = std::max(0.0, charge_ - current * dt / (3600.0 * options_.battery_capacity));
  current_ = -current;
  voltage_ = open - r * current;
}

Measurement ChassisModel::measurement() const
{
  Measurement measured;
  measured.speed = speed_;
  measured.curvature = curvature_;
  measured.steering = steering_;
  measured.travel = travel_;
  measured.yaw_rate = yaw_rate_;
  measured.turn = turn_;
  measured.battery_voltage = voltage_;
  measured.battery_current = current_;
  measured.battery_charge = charge_;
  measured.faults =
      static_cast<uint16_t>((charge_ < options_.battery_low ? chassis::BATTERY_LOW : 0) |
                            (charge_ <= 0.0 ? chassis::BATTERY_EMPTY : 0) | (button_ ? chassis::EMERGENCY_BUTTON : 0));
  return measured;
}

}  // namespace pi_simulation
