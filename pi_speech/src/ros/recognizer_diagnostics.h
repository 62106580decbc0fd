#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/audio.h>
#include <pi_speech/command_recognizer.h>
#include "ros/recognizer_tasks.h"
#include "audio/sound_check.h"
#include <ros/node_handle.h>

#include <cstdint>
#include <mutex>
#include <string>

namespace pi_speech
{

/// What the adapter knows of itself, for the diagnostics.
struct RecognizerFigures
{
  std::string topic;
  bool listening = false;   ///< was not stopped
  bool subscribed = false;  ///< to sound

  std::string understood;  ///< the commands in use; empty: none yet
  size_t commands = 0;     ///< number of them
  bool word_models = false;
  std::string mode;
  std::string loading;  ///< table that is being loaded; empty: none
  std::string problem;  ///< why the table asked for last is not in use; empty: it is

  AudioFormat format;         ///< of the sound that comes
  bool format_known = false;  ///< from audio_info
  std::string input_problem;  ///< why the sound cannot be used; empty: it can
  SoundState sound = SoundState::GOOD;
  std::string sound_text;
  double level_dbfs = 0.0;
  double clipped_share = 0.0;
  double noise_dbfs = 0.0;
  bool in_speech = false;

  uint64_t chunks = 0;     ///< that came
  uint64_t dropped = 0;    ///< as the worker was not free in time
  uint64_t unusable = 0;   ///< truncated, or of a format that is not understood
  uint64_t gaps = 0;       ///< in the stamps
  uint64_t backs = 0;      ///< times that the stamps went back
  uint64_t formats = 0;    ///< changes of format on the way
  double waiting_s = 0.0;  ///< sound in the queue

  bool use_runtime = false;
  RecognizerTasks::Figures tasks;

  bool dictation = false;
  std::string dictation_problem;
  uint64_t dictated = 0;
  uint64_t dictation_dropped = 0;
};

/// What /diagnostics says: what is understood and how soon, what comes in and what was wrong with it.
class RecognizerDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param warnings  outlives it.
  RecognizerDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                        const pi_node::WarningBoard* warnings);

  /// After each that was decided. Any thread.
  /// @param latency_s  from the end of the speech until it was published; counts for commands.
  void addRecognition(const Recognition& recognition, double latency_s);
  /// Any thread. @param cpu_s  that worker and tasks used for it. @param sound_s  length of that sound.
  void addWork(double cpu_s, double sound_s);

  /// Looks at everything and publishes. One thread at a time.
  void update(const RecognizerFigures& figures);

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  void reportRecognition(Status& status);
  void reportSound(Status& status) const;

  const pi_node::WarningBoard* const warnings_;
  diagnostic_updater::Updater updater_;
  RecognizerFigures now_;

  std::mutex mutex_;  ///< of all below
  uint64_t accepted_ = 0;
  uint64_t fast_ = 0;
  uint64_t rejected_ = 0;
  std::string last_command_;
  std::string last_rejected_;
  double last_latency_s_ = 0.0;
  pi_node::RecentValues latency_ms_;
  pi_node::RecentValues decision_ms_;
  double cpu_s_ = 0.0;  ///< both since the last update
  double sound_s_ = 0.0;
  double cpu_share_ = 0.0;
};

}  // namespace pi_speech
