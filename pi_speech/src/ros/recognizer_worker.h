#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_speech/AudioData.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_speech/command_recognizer.h>
#include <ros/node_handle.h>

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "ros/recognizer_diagnostics.h"
#include "ros/recognizer_ros_options.h"
#include "ros/recognizer_tasks.h"
#include "ros/sound_queue.h"
#include "ros/sound_stream.h"
#include "ros/sound_watch.h"
#include "ros/utterance_service.h"

namespace pi_speech
{

/// Recognises commands in queued sound, on the thread `speech_worker`.
///
/// The worker keeps its recogniser while another one is loaded, and exchanges it when nobody speaks. Sound that comes
/// before the first one is loaded waits in the queue. Sound that is missing, goes back in time or changes its format
/// ends the speech in progress, as does sound that stays away for check/missing_s.
///
/// All functions but start() and stop() may be called by any thread.
class RecognizerWorker
{
public:
  /// Called on the thread of the worker.
  struct Outputs
  {
    /// @param latency_s  from the end of the speech until now: sound that came after it, and the time since then [s].
    std::function<void(const VoiceCommand&, const Recognition&, double latency_s)> recognition;
    std::function<void(const Utterance&, const Recognition&)> utterance;  ///< after each that has ended
  };

  /// @param options, warnings, diagnostics  outlive it.
  RecognizerWorker(const ros::NodeHandle& node, const RecognizerRosOptions& options, const std::string& topic,
                   pi_node::WarningBoard* warnings, RecognizerDiagnostics* diagnostics, Outputs outputs);
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
  void use(std::unique_ptr<CommandRecognizer> recognizer, const std::string& understood);
  /// @return the commands that stay in use; empty: none.
  std::string failLoading(const std::string& problem);

  /// Also looks whether sound stays away. @param subscribed  false: no sound is awaited.
  void report(bool subscribed, RecognizerFigures* figures);

private:
  using Clock = std::chrono::steady_clock;

  struct Loaded
  {
    std::unique_ptr<CommandRecognizer> recognizer;
    std::string understood;
  };

  void work();
  double cpuSeconds() const;  ///< that worker and tasks have used
  void takeOver(Loaded loaded);
  void workOn(const SoundChunk& chunk);
  void noteBreak(const SoundChunk& chunk, SoundStream::Break found, double gap_s);
  /// Runs a step of the recogniser; its errors become warnings.
  void recognize(const std::function<void(const CommandRecognizer::Sink&)>& step);
  /// Ends the piece of the stream and the speech in progress. @param tell  false: what was said is forgotten.
  void endPiece(bool tell);
  void onRecognition(const Recognition& recognition);
  void onUtterance(const Utterance& utterance, const Recognition& recognition);

  const RecognizerRosOptions& options_;
  const std::string topic_;
  pi_node::WarningBoard* const warnings_;
  RecognizerDiagnostics* const diagnostics_;
  const Outputs outputs_;
  const std::unique_ptr<RecognizerTasks> tasks_;       ///< null: decisions are plain calls
  const std::unique_ptr<UtteranceService> elsewhere_;  ///< null: all is decided here
  SoundWatch watch_;

  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable changed_;
  bool stopping_ = false;
  bool taking_ = false;
  bool forget_ = false;  ///< what came before does not belong to what comes
  SoundQueue queue_;
  Loaded next_;                ///< null: none
  RecognizerFigures figures_;  ///< those that the worker knows

  // Of the thread.
  SoundStream stream_;
  std::unique_ptr<CommandRecognizer> recognizer_;  ///< null: none is loaded yet
  int64_t recognizer_begin_ = 0;                   ///< sample of the stream that was its first
  Clock::time_point came_at_;                      ///< the message in work
  std::string frame_id_;
  bool forgetting_ = false;  ///< what is recognised is told to nobody
  std::vector<int16_t> raw_;
  Samples samples_;
  std::thread thread_;
};

}  // namespace pi_speech
