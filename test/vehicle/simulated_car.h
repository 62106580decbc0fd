#pragma once

#include "decision/drive_command.h"

#include <pi_vehicle/chassis/chassis_model.h>
#include <pi_vehicle/decision/pose2.h>

#include <algorithm>

namespace pi_vehicle
{

/// The example car, with ramps as its motor controller has them.
class SimulatedCar
{
public:
  explicit SimulatedCar(const Pose2& start = Pose2()) : model_(chassis::ModelOptions())
  {
    model_.setPose({start.x, start.y, start.heading});
  }

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

  Pose2 pose() const { return {model_.pose().x, model_.pose().y, wrapAngle(model_.pose().yaw)}; }
  double speed() const { return model_.measurement().speed; }
  double curvature() const { return model_.measurement().curvature; }
  double travel() const { return travel_; }  ///< [m]

private:
  chassis::ChassisModel model_;
  chassis::Setpoint setpoint_;
  double travel_ = 0.0;
};

}  // namespace pi_vehicle
