#pragma once

#include <pi_vehicle/ArbiterState.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <topic_tools/shape_shifter.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle::recorder
{

struct Trigger
{
  std::string cause;  ///< as in Incident.msg
  std::string text;
};

/// Finds the moments worth keeping in what the vehicle says. Each lasting state triggers once, when it begins. Not
/// thread safe.
class IncidentTriggers
{
public:
  /// @param braking_deceleration  a command to brake as hard is an emergency [m/s^2].
  /// @param take_over_sources  sources of the arbiter that are people.
  IncidentTriggers(double braking_deceleration, std::vector<std::string> take_over_sources);

  std::optional<Trigger> onArbiter(const ArbiterState& state);
  std::optional<Trigger> onVehicle(const VehicleState& state);
  /// A hard braking that follows another within a second is the same.
  std::optional<Trigger> onMotion(const MotionCommand& command, int64_t now_ns);
  /// std_msgs/Bool: true is a collision, again after a false; std_msgs/String: what was hit. Any other message is one.
  std::optional<Trigger> onCollision(const topic_tools::ShapeShifter& message);

private:
  const double braking_deceleration_;
  const std::vector<std::string> take_over_sources_;
  bool emergency_ = false;
  bool person_drives_ = false;
  bool required_lived_ = false;  ///< all required sources, since the last time that one fell silent
  bool drove_ = false;           ///< the chassis was ready since its last trouble
  uint8_t mode_ = VehicleState::DISCONNECTED;
  double speed_ = 0.0;
  int64_t braked_ns_ = INT64_MIN / 2;
  bool touches_ = false;
};

}  // namespace pi_vehicle::recorder
