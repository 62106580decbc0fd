#pragma once

#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

namespace pi_speech
{

/// What is to be played, as listSoundFiles takes it. As a parameter: a text, or a list of texts.
struct SoundFileEntries
{
  std::vector<std::string> entries;
};

/// The parameters of the player node; config/player.yaml shows each with its unit.
struct PlayerRosOptions : pi_node::NodeParameters<PlayerRosOptions>
{
  SoundFileEntries files;             ///< absolute
  double rate = 1.0;                  ///< of playing: seconds of sound per second, in [0.01, 1000]
  bool loop = false;                  ///< after the last file the first again
  double gap_s = 1.0;                 ///< of low noise after each file [s], in [0, 60]
  double gap_level_dbfs = -70.0;      ///< of that noise [dB of full scale], in [-120, 0]
  double period_s = 0.02;             ///< of sound in a message [s], in [0.002, 1]
  bool start_when_subscribed = true;  ///< to audio_stamped; false: at once
  std::string frame_id = "microphone";

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_speech

extern template struct pi_node::NodeParameters<pi_speech::PlayerRosOptions>;
