#pragma once

#include <pi_node/ros/node_parameters.h>
#include "audio/microphone.h"
#include "audio/sound_check.h"

#include <string>
#include <vector>

namespace pi_speech
{

/// The parameters of the microphone node; config/microphone.yaml shows each with its unit.
struct MicrophoneRosOptions : pi_node::NodeParameters<MicrophoneRosOptions>
{
  MicrophoneOptions microphone;
  SoundCheckOptions check;  ///< but missing_s: the microphone says itself that it is gone
  std::string frame_id = "microphone";

  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_speech

extern template struct pi_node::NodeParameters<pi_speech::MicrophoneRosOptions>;
