#pragma once

#include "chassis/chassis_controller.h"

#include <pi_vehicle/chassis/chassis_protocol.h>
#include <pi_vehicle/decision/pose2.h>

#include <deque>

namespace pi_simulation
{

struct ModelOptions
{
  chassis::Kind kind = chassis::Kind::CAR_LIKE;
  double wheelbase = 0.75;         ///< [m]; of a differential one: between its wheels
  double max_steering = 0.33;      ///< [rad], car-like only
  double max_steering_rate = 0.6;  ///< [rad/s], car-like only
  double speed_lag_s = 0.15;       ///< time constant of the drive
  double steering_lag_s = 0.1;     ///< time constant of the steering
  double dead_time_s = 0.05;       ///< from setpoint to any effect

  double mass = 120.0;                 ///< [kg]
  double rolling_resistance = 0.02;    ///< of the weight
  double efficiency = 0.8;             ///< of the drive
  double idle_power = 25.0;            ///< of computer and sensors [W]
  double battery_capacity = 40.0;      ///< [Ah]
  double battery_full_voltage = 29.2;  ///< without load [V]
  double battery_empty_voltage = 22.0;
  double battery_resistance = 0.03;  ///< [ohm]
  double battery_charge = 0.9;       ///< at the start, 0 to 1
  double battery_low = 0.15;         ///< BATTERY_LOW is told below

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Models a vehicle's motion and battery. Setpoints pass a dead time and first-order lags of speed and steering, with
/// limited steering rate; the kinematic bicycle (or differential) model then moves on exact arcs. A yaw rate has the
/// lag of the speed, as both come from the same wheels. Deterministic; not thread safe.
class ChassisModel
{
public:
  /// @throws std::invalid_argument for wrong options.
  explicit ChassisModel(const ModelOptions& options);

  /// Advances by dt [s], clamped to [0, 1], in steps of 1 ms at most.
  void step(const Setpoint& setpoint, double dt);
  Measurement measurement() const;
  /// Of the middle of the rear axle, or of the only axle.
  const pi_vehicle::Pose2& pose() const { return pose_; }
  void setPose(const pi_vehicle::Pose2& pose) { pose_ = pose; }
  double time() const { return time_; }  ///< simulated so far [s]

  /// Blocks the wheels, or frees them.
  void setStuck(bool stuck) { stuck_ = stuck; }
  /// @param share  of the way of the wheels that the vehicle does not go, clamped to [0, 1].
  void setSlip(double share);
  double groundSpeed() const { return (1.0 - slip_) * speed_; }  ///< measurement() has that of the wheels [m/s]
  /// @param charge  is clamped to [0, 1].
  void setBatteryCharge(double charge);
  void setEmergencyButton(bool pressed) { button_ = pressed; }

private:
  struct Waiting
  {
    double due;  ///< [s]
    Setpoint setpoint;
  };

  void substep(double dt);
  void discharge(double acceleration, double dt);

  const ModelOptions options_;
  std::deque<Waiting> waiting_;
  Setpoint effective_;
  double time_ = 0.0;
  pi_vehicle::Pose2 pose_;
  double speed_ = 0.0;
  double steering_ = 0.0;   ///< car-like
  double curvature_ = 0.0;  ///< of a differential vehicle that turns by a yaw rate: 0 while it stands
  double yaw_rate_ = 0.0;
  double travel_ = 0.0;
  double turn_ = 0.0;
  double charge_;
  double current_ = 0.0;  ///< negative while it gives
  double voltage_;
  bool stuck_ = false;
  double slip_ = 0.0;
  bool button_ = false;
};

}  // namespace pi_simulation
