#include "ros/recorder/incident_triggers.h"

#include <pi_node/formatting.h>
#include <std_msgs/Bool.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_vehicle::recorder
{
namespace
{

constexpr double MOVES = 0.1;  // [m/s]
constexpr int64_t SAME_BRAKING_NS = 1000000000;

}  // namespace

IncidentTriggers::IncidentTriggers(double braking_deceleration, std::vector<std::string> take_over_sources)
  : braking_deceleration_(braking_deceleration), take_over_sources_(std::move(take_over_sources))
{
}

std::optional<Trigger> IncidentTriggers::onArbiter(const ArbiterState& state)
{
  const bool person = std::count(take_over_sources_.begin(), take_over_sources_.end(), state.driver) > 0;
  std::string silent;
  for (const SourceState& source : state.sources)
  {
    silent += source.required && !source.alive ? (silent.empty() ? "" : ", ") + source.name : "";
  }
  const bool emergency = state.emergency != 0;
  const bool emergency_begins = !std::exchange(emergency_, emergency) && emergency;
  const bool person_begins = !std::exchange(person_drives_, person) && person;
  const bool silence_begins = !silent.empty() && std::exchange(required_lived_, false);
  required_lived_ = required_lived_ || silent.empty();
  if (emergency_begins)
  {
    return Trigger{"emergency_braking", "the emergency stop of the arbiter: " + state.reason};
  }
  if (silence_begins)
  {
    return Trigger{"watchdog", "silent to the arbiter: " + silent};
  }
  if (person_begins)
  {
    return Trigger{"take_over", state.driver + " drives"};
  }
  return std::nullopt;
}

std::optional<Trigger> IncidentTriggers::onVehicle(const VehicleState& state)
{
  speed_ = state.speed;
  const uint8_t before = std::exchange(mode_, state.mode);
  const bool ready = state.mode == VehicleState::READY || state.mode == VehicleState::DRIVING;
  drove_ = drove_ || ready;
  if (ready || state.mode == before || !drove_)
  {
    return std::nullopt;
  }
  if (state.mode == VehicleState::EMERGENCY_STOP)
  {
    return Trigger{"emergency_braking", "the emergency stop of the chassis: " + state.detail};
  }
  if (!std::exchange(drove_, false))
  {
    return std::nullopt;  // one trouble after the other
  }
  return Trigger{"watchdog", "the chassis: " + state.detail};
}

std::optional<Trigger> IncidentTriggers::onMotion(const MotionCommand& command, int64_t now_ns)
{
  const bool brakes = command.max_deceleration >= braking_deceleration_ && std::abs(speed_) > MOVES &&
                      std::abs(command.speed) < std::abs(speed_);
  if (!brakes)
  {
    return std::nullopt;
  }
  const int64_t since_ns = now_ns - std::exchange(braked_ns_, now_ns);
  if (since_ns < SAME_BRAKING_NS)
  {
    return std::nullopt;
  }
  return Trigger{
      "emergency_braking",
      pi_node::format("%.1f m/s^2 asked for at %.1f m/s: ", command.max_deceleration, speed_) + command.reason};
}

std::optional<Trigger> IncidentTriggers::onCollision(const topic_tools::ShapeShifter& message)
{
  std::string text = "reported by a sensor";
  if (message.getDataType() == "std_msgs/Bool")
  {
    const bool touches = message.instantiate<std_msgs::Bool>()->data;
    if (std::exchange(touches_, touches) || !touches)
    {
      return std::nullopt;
    }
  }
  else if (message.getDataType() == "std_msgs/String")
  {
    text = message.instantiate<std_msgs::String>()->data;
  }
  return Trigger{"collision", text};
}

}  // namespace pi_vehicle::recorder
