#pragma once

#include <pi_node/ros/node_parameters.h>
#include <pi_speech/audio.h>
#include <pi_speech/command_recognizer.h>
#include "audio/sound_check.h"

#include <string>
#include <vector>

namespace pi_speech
{

/// The parameters of the recognizer node; config/recognizer.yaml shows each with its unit.
struct RecognizerRosOptions : pi_node::NodeParameters<RecognizerRosOptions>
{
  std::string commands;  ///< YAML file of the commands, absolute; empty: the package's commands.yaml
  /// Its files are absolute; empty: the package's. word_network and sphinx.adaptation may be "none".
  RecognizerOptions recognizer;
  bool use_runtime = true;  ///< decisions are a stage of pi_runtime::Runtime::shared(); false: plain calls
  /// Service (pi_speech/RecognizeUtterance) that is asked for each utterance first, such as pi_offload's; empty: none.
  std::string utterance_service;
  double utterance_deadline_s = 0.30;  ///< from a pause to the decision, here or elsewhere [s], in [0.05, 5]
  bool start_listening = true;         ///< false: not before ~start
  /// Also without subscribers: the noise must be known before the first "stop".
  bool always_on = true;
  bool dictation = false;  ///< publishes the text of other speech

  bool stamped = true;     ///< sound comes on audio_stamped; false: on audio, stamped on arrival
  AudioFormat format;      ///< of sound that comes before audio_info
  double max_gap_s = 0.1;  ///< largest gap between two messages [s], in [0.005, 10]
  double queue_s = 5.0;    ///< of sound that may wait; then the oldest is dropped [s], in [0.1, 60]
  SoundCheckOptions check;

  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// The recogniser's options with the package's files where none is given.
  /// @param package  folder of pi_speech; one without network or adaptation is used without. Its adaptation
  ///   belongs to the default acoustic model, and is not used with others.
  RecognizerOptions recognizerOptions(const std::string& package) const;
  /// @param package  as above.
  std::string commandsFile(const std::string& package) const;
};

}  // namespace pi_speech

extern template struct pi_node::NodeParameters<pi_speech::RecognizerRosOptions>;
