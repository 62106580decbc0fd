#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/warning_board.h>
#include <ros/node_handle.h>

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "ros/dictation.h"
#include "ros/sound_queue.h"
#include "ros/sound_watch.h"
#include "ros/stream_recognizer.h"

namespace pi_speech
{

/// What the recognizer node knows of itself, for the diagnostics.
struct RecognizerFigures
{
  std::string topic;
  bool listening = false;   ///< was not stopped
  bool subscribed = false;  ///< to sound

  std::string mode;
  std::string loading;     ///< table that is being loaded; empty: none
  std::string problem;     ///< why the table asked for last is not in use; empty: it is
  std::string no_network;  ///< why it works without the word network; empty: as it was asked for

  SoundQueue::Figures queue;
  SoundWatch::Figures sound;
  StreamRecognizer::Figures stream;
  std::optional<Dictation::Figures> dictation;  ///< nullopt: not asked for
};

/// Publishes on /diagnostics what is understood and how soon, what sound comes in, and what was wrong with it.
class RecognizerDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param warnings  outlives it.
  RecognizerDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                        const pi_node::WarningBoard* warnings);

  /// After each decision. Any thread. @param latency_s  from the end of the speech until it was published.
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
  uint64_t doubtful_ = 0;
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
