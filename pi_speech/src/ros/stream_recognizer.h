#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_runtime/stage.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_speech/command_recognizer.h>
#include <ros/node_handle.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "ros/recognizer_ros_options.h"
#include "ros/sound_queue.h"
#include "ros/sound_stream.h"
#include "ros/sound_watch.h"
#include "ros/utterance_service.h"

namespace pi_speech
{

/// Recognises commands in a stream of messages of sound. Sound that is missing, goes back in time or changes its format
/// ends the speech in progress. Not thread safe.
class StreamRecognizer
{
public:
  struct Outputs
  {
    /// @param latency_s  from the end of the speech until now: sound that came after it, and the time since then [s].
    std::function<void(const VoiceCommand&, const Recognition&, double latency_s)> recognition;
    std::function<void(const Utterance&, const Recognition&)> utterance;  ///< after each that has ended
  };
  struct Figures
  {
    std::string understood;  ///< the commands in use; empty: none yet
    size_t commands = 0;     ///< number of them
    size_t spotted = 0;      ///< commands that are heard in running speech
    size_t guessed = 0;      ///< words that no dictionary has
    double noise_dbfs = 0.0;
    bool in_speech = false;
    uint64_t damaged = 0;  ///< messages
    uint64_t gaps = 0;     ///< in the stamps
    uint64_t backs = 0;    ///< times that the stamps went back
    uint64_t formats = 0;  ///< changes of format on the way
    pi_runtime::StageStatus decisions;
  };

  /// @param options, warnings, watch  outlive it.
  StreamRecognizer(const ros::NodeHandle& node, const RecognizerRosOptions& options, const std::string& topic,
                   pi_node::WarningBoard* warnings, SoundWatch* watch, Outputs outputs);

  /// Exchanges the recogniser; nobody may be speaking. Sound that is added before the first one is lost.
  void use(std::unique_ptr<CommandRecognizer> recognizer, const std::string& understood);
  bool ready() const { return recognizer_ != nullptr; }
  bool inSpeech() const { return recognizer_ && recognizer_->inSpeech(); }
  void add(const SoundChunk& chunk);
  /// Ends the piece of the stream and the speech in progress. @param tell  false: what was said is forgotten.
  void end(bool tell);
  Figures figures() const;
  double cpuSeconds() const;  ///< that the calling thread and decisions have used

private:
  void noteBreak(const SoundChunk& chunk, SoundStream::Break found, double gap_s);
  /// Runs a step of the recogniser; its errors become warnings.
  void recognize(const std::function<void(const CommandRecognizer::Sink&)>& step);
  void onRecognition(Recognition recognition);
  bool isFast(const std::string& command) const;
  void onUtterance(const Utterance& utterance, const Recognition& recognition);

  const RecognizerRosOptions& options_;
  const std::string topic_;
  pi_node::WarningBoard* const warnings_;
  SoundWatch* const watch_;
  const Outputs outputs_;
  pi_runtime::Stage stage_;                            ///< decisions
  const std::unique_ptr<UtteranceService> elsewhere_;  ///< null: all is decided here
  SoundStream stream_;
  std::unique_ptr<CommandRecognizer> recognizer_;  ///< null: none is loaded yet
  int64_t recognizer_begin_ = 0;                   ///< sample of the stream that was its first
  std::chrono::steady_clock::time_point came_at_;  ///< the message in work
  std::string frame_id_;
  bool forgetting_ = false;  ///< what is recognised is told to nobody
  Figures figures_;          ///< those that are counted
  ClippingRecord clipping_;
  std::vector<int16_t> raw_;
  Samples samples_;
};

}  // namespace pi_speech
