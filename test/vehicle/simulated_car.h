#pragma once

#include "chassis/chassis_model.h"
#include "decision/drive_command.h"

#include <algorithm>

namespace pi_vehicle
{

/// The example car, with ramps as its motor controller has them.
class SimulatedCar
{
public:
  explicit SimulatedCar(const Pose2& start = Pose2()) : model_(pi_simulation::ModelOptions()) { model_.setPose(start); }

  /// @param dt  [s], at most 1.
  void step(const DriveCommand& command, double dt)
  {
    const double braking = command.max_deceleration > 0.0 ? command.max_deceleration : 1.0;
    setpoint_.speed = std::clamp(command.speed, setpoint_.speed - braking * dt, setpoint_.speed + 1.5 * dt);
    setpoint_.curvature = command.curvature;
    const double before = model_.measurement().travel;
    model_.step(setpoint_, dt);
    travel_ += model_.measurement().travel - before;
  }

  Pose2 pose() const { return model_.pose(); }
  double speed() const { return model_.measurement().speed; }
  double curvature() const { return model_.measurement().curvature; }
  double travel() const { return travel_; }  ///< [m]

private:
  pi_simulation::ChassisModel model_;
  pi_simulation::Setpoint setpoint_;
  double travel_ = 0.0;
};

}  // namespace pi_vehicle
