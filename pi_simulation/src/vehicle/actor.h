#pragma once

#include "vehicle/scenario.h"
#include "world/synthetic_world.h"

#include <string>
#include <vector>

namespace pi_simulation
{

/// A person or an object that moves on its path. Deterministic; not thread safe.
class Actor
{
public:
  explicit Actor(const ActorPlan& plan);

  /// Advances by dt [s].
  /// @param time  since the start, at the end of the step [s]. @param vehicle  reference point of the vehicle [m].
  /// @return true in the step that triggers the actor.
  bool step(double time, double dt, const Eigen::Vector2d& vehicle);
  /// Triggers the actor with the next step.
  void go() { ordered_ = true; }

  const ActorPlan& plan() const { return plan_; }
  ActorState state() const;
  bool triggered() const { return triggered_; }

private:
  bool due(double time, const Eigen::Vector2d& vehicle) const;

  ActorPlan plan_;
  std::vector<double> lengths_;  ///< of the path up to each point [m]
  bool ordered_ = false;
  bool triggered_ = false;
  bool gone_ = false;    ///< vanished
  double since_ = 0.0;   ///< triggered [s]
  double walked_ = 0.0;  ///< [m]
  double speed_ = 0.0;   ///< [m/s]
  size_t pause_ = 0;     ///< the next one
  double paused_ = 0.0;  ///< of it [s]
};

}  // namespace pi_simulation
