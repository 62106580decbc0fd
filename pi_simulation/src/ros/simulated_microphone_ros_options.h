#pragma once

#include "vehicle/microphone_mixer.h"

#include <pi_node/ros/node_parameters.h>

#include <string>

namespace pi_simulation
{

/// The parameters of the simulated microphone; config/simulated_microphone.yaml shows each with its unit.
struct SimulatedMicrophoneRosOptions : pi_node::NodeParameters<SimulatedMicrophoneRosOptions>
{
  MicrophoneMixerOptions mixer;
  std::string frame_id = "microphone";

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_simulation

extern template struct pi_node::NodeParameters<pi_simulation::SimulatedMicrophoneRosOptions>;
