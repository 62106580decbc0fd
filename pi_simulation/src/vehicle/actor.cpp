#include "vehicle/actor.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation
{
namespace
{

constexpr double ARRIVED_M = 0.005;

}  // namespace

Actor::Actor(const ActorPlan& plan) : plan_(plan)
{
  double length = 0.0;
  for (size_t i = 0; i < plan_.path.size(); ++i)
  {
    length += i > 0 ? (plan_.path[i] - plan_.path[i - 1]).norm() : 0.0;
    lengths_.push_back(length);
  }
}

bool Actor::due(double time, const Eigen::Vector2d& vehicle) const
{
  const ActorTrigger& trigger = plan_.trigger;
  if (ordered_)
  {
    return true;
  }
  const bool there = !trigger.near || (vehicle - *trigger.near).norm() <= trigger.within;
  return there && !trigger.command && time >= trigger.time.value_or(0.0);
}

bool Actor::step(double time, double dt, const Eigen::Vector2d& vehicle)
{
  if (!triggered_)
  {
    triggered_ = due(time, vehicle);
    return triggered_;
  }
  since_ += dt;
  const double length = lengths_.back();
  const bool pausing = pause_ < plan_.pauses.size() && plan_.pauses[pause_].at < length;
  const double stop = pausing ? plan_.pauses[pause_].at : length;
  const double left = std::max(stop - walked_, 0.0);
  if (left <= ARRIVED_M)
  {
    speed_ = 0.0;
    if (pausing)
    {
      paused_ += dt;
      if (paused_ >= plan_.pauses[pause_].duration)
      {
        ++pause_;
        paused_ = 0.0;
      }
    }
    gone_ = gone_ || (!pausing && plan_.vanish_at_end);
  }
  else
  {
    // The largest speed from which it can stop there, but large enough to arrive.
    const double braking = std::sqrt(2.0 * plan_.acceleration * left);
    speed_ = std::min({plan_.speed, braking, speed_ + plan_.acceleration * dt});
    walked_ = std::min(walked_ + speed_ * dt, stop);
  }
  gone_ = gone_ || (plan_.vanish_after && since_ >= *plan_.vanish_after);
  return false;
}

ActorState Actor::state() const
{
  ActorState state;
  state.present = !gone_ && (triggered_ || !plan_.hidden);
  state.walked = walked_;
  if (plan_.path.size() < 2)
  {
    state.position = plan_.path.front();
    state.heading = plan_.heading;
    return state;
  }
  const auto next = std::upper_bound(lengths_.begin() + 1, lengths_.end() - 1, walked_);
  const auto i = static_cast<size_t>(next - lengths_.begin());
  const Eigen::Vector2d edge = plan_.path[i] - plan_.path[i - 1];
  const double length = lengths_[i] - lengths_[i - 1];
  const Eigen::Vector2d axis = length > 1e-9 ? Eigen::Vector2d(edge / length) : Eigen::Vector2d::UnitX();
  state.position = plan_.path[i - 1] + axis * (walked_ - lengths_[i - 1]);
  state.heading = std::atan2(axis.y(), axis.x());
  state.velocity = speed_ * axis;
  return state;
}

}  // namespace pi_simulation
