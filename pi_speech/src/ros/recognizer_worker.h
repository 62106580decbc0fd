#pragma once

#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/AudioData.h>
#include <pi_speech/AudioInfo.h>
#include <ros/node_handle.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "ros/recognizer_diagnostics.h"
#include "ros/recognizer_ros_options.h"
#include "ros/sound_queue.h"
#include "ros/sound_watch.h"
#include "ros/stream_recognizer.h"

namespace pi_speech
{

/// Recognises commands in queued sound, on the thread `speech_worker`.
///
/// The worker keeps its recogniser while another one is loaded, and exchanges it when nobody speaks. Sound that comes
/// before the first one is loaded waits in the queue. Sound that stays away for check/missing_s ends the speech in
/// progress.
///
/// All functions but start() and stop() may be called by any thread.
class RecognizerWorker
{
public:
  /// @param options, warnings, diagnostics  outlive it. @param outputs  are called on the thread of the worker.
  RecognizerWorker(const ros::NodeHandle& node, const RecognizerRosOptions& options, const std::string& topic,
                   pi_node::WarningBoard* warnings, RecognizerDiagnostics* diagnostics,
                   StreamRecognizer::Outputs outputs);
  RecognizerWorker(const RecognizerWorker&) = delete;
  RecognizerWorker& operator=(const RecognizerWorker&) = delete;

  void start();
  /// Returns when a decision in work is made. After start() it must be called before destruction.
  void stop();

  /// @return false if the sound is ignored.
  bool add(const AudioDataConstPtr& audio, const std_msgs::Header& header);
  void addInfo(const AudioInfo& info, const std::string& topic);
  /// Begins or ends to take sound. What was said before the end is forgotten.
  void take(bool wanted);

  void beginLoading(const std::string& name);
  /// @param no_network  why it works without the word network; empty: as it was asked for.
  void use(std::unique_ptr<CommandRecognizer> recognizer, const std::string& understood, const std::string& no_network);
  /// @return the commands that stay in use; empty: none.
  std::string failLoading(const std::string& problem);

  /// Also looks whether sound stays away. @param subscribed  false: no sound is awaited.
  void report(bool subscribed, RecognizerFigures* figures);

private:
  struct Loaded
  {
    std::unique_ptr<CommandRecognizer> recognizer;
    std::string understood;
  };

  void work();
  void tell(const VoiceCommand& message, const Recognition& recognition, double latency_s);

  const RecognizerRosOptions& options_;
  pi_node::WarningBoard* const warnings_;
  RecognizerDiagnostics* const diagnostics_;
  const StreamRecognizer::Outputs outputs_;
  SoundWatch watch_;

  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable changed_;
  bool stopping_ = false;
  bool taking_ = false;
  bool forget_ = false;  ///< what came before does not belong to what comes
  SoundQueue queue_;
  Loaded next_;                ///< null: none
  RecognizerFigures figures_;  ///< those that the worker knows

  StreamRecognizer stream_;  ///< of the thread
  pi_node::SimulationAnswers answers_;
  std::thread thread_;
};

}  // namespace pi_speech
