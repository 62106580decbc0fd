#pragma once

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/AudioData.h>
#include <pi_speech/AudioDataStamped.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/SetCommands.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_speech/command_recognizer.h>
#include "ros/recognizer_diagnostics.h"
#include "ros/recognizer_ros_options.h"
#include "ros/recognizer_tasks.h"
#include "ros/sound_stream.h"
#include "ros/utterance_service.h"
#include "audio/sound_check.h"
#include <ros/ros.h>
#include <std_srvs/Empty.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_speech
{

/// Spoken commands on the graph.
///
/// In: `audio_stamped` (pi_speech/AudioDataStamped; or `audio`, pi_speech/AudioData) and `audio_info`
/// (pi_speech/AudioInfo), as audio_capture has them. Out: `command` (pi_speech/VoiceCommand) and `recognizer/output`
/// (std_msgs/String), the commands that are accepted; `~rejected` (VoiceCommand), what was heard and is none;
/// `dictation` (std_msgs/String), other speech, if asked for. Services: `~start`, `~stop`, `~set_commands`.
///
/// VoiceCommand.latency is the sound from the end of the speech to the end of the message of sound with which it was
/// decided, and the time from the arrival of that message to publication, by a clock that does not jump. It so holds
/// for a microphone as well as for a recording, whatever the stamps; the time that sound takes to arrive does not
/// count.
///
/// Sound that is missing, goes back or changes its format ends speech in progress, as does sound that stays away for
/// check/missing_s. What was said when the recogniser was stopped is forgotten.
///
/// Threads: `speech_input` gets sound, which waits in a queue for `speech_worker`, where it is recognised;
/// `speech_loader` loads tables and models, and takes set_commands; `speech_service` takes start and stop, looks who
/// listens, and publishes diagnostics; `speech_dictate`, if asked for, writes down with low priority. The worker goes
/// on with the commands that it has while others are loaded, and takes those once nobody speaks; sound that comes
/// before the first are loaded waits in the queue. Decisions run on a unit of the runtime, see RecognizerTasks, while
/// the worker waits; without use_runtime on the worker.
///
/// With utterance_service each utterance is first offered to that service, as pi_offload/coordinator has it; what it
/// does not handle, or not in time, is recognised here.
///
/// A model or table that cannot be used is an error in log and diagnostics; the node stays, and set_commands tries
/// again.
class RecognizerRos
{
public:
  /// Advertises, and begins to load. @throws std::invalid_argument for wrong parameters.
  RecognizerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Waits for a model that is being loaded.
  ~RecognizerRos();
  RecognizerRos(const RecognizerRos&) = delete;
  RecognizerRos& operator=(const RecognizerRos&) = delete;

private:
  using Clock = std::chrono::steady_clock;

  /// A message of sound, as it came.
  struct Chunk
  {
    AudioDataConstPtr audio;
    AudioFormat format;
    int64_t stamp_ns = 0;
    std::string frame_id;
    Clock::time_point came_at;
    double duration_s = 0.0;
    bool after_loss = false;  ///< messages before it were dropped
  };

  /// Commands asked for: of a file, or else these.
  struct Source
  {
    std::string file;
    std::vector<std::string> texts;
    std::string name() const;
  };

  /// A recogniser on its way to the worker.
  struct Loaded
  {
    std::unique_ptr<CommandRecognizer> recognizer;
    std::string understood;
  };

  // speech_input
  void onStamped(const AudioDataStampedConstPtr& message);
  void onAudio(const AudioDataConstPtr& message);
  void onInfo(const AudioInfoConstPtr& message);
  void take(Chunk chunk, const std_msgs::Header& header);

  // speech_worker
  void work();
  double cpuSeconds() const;  ///< that worker and tasks have used
  void takeOver(Loaded loaded);
  void workOn(const Chunk& chunk);
  void checkSound(const Chunk& chunk);
  void recognize(const Samples& samples);
  /// Ends the piece of the stream, and speech in progress. @param tell  what was said.
  void endPiece(bool tell);
  void onRecognition(const Recognition& recognition);
  void onUtterance(const Utterance& utterance, const Recognition& recognition);

  // speech_loader
  /// @param[out] message  what is understood, or why not.
  bool load(const Source& source, std::string* message);
  bool setCommands(SetCommands::Request& request, SetCommands::Response& response);

  // speech_service
  bool start(std_srvs::Empty::Request& request, std_srvs::Empty::Response& response);
  bool stop(std_srvs::Empty::Request& request, std_srvs::Empty::Response& response);
  void updateSubscription();
  void publishDiagnostics();

  // speech_dictate
  void dictate();

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread loader_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle input_node_;
  ros::NodeHandle service_node_;
  ros::NodeHandle service_private_node_;
  ros::NodeHandle loader_private_node_;
  const RecognizerRosOptions options_;
  const std::string package_;  ///< folder of pi_speech
  const std::string topic_;    ///< of the sound
  const std::string info_topic_;
  pi_node::WarningBoard warnings_;
  RecognizerDiagnostics diagnostics_;
  const std::unique_ptr<RecognizerTasks> tasks_;       ///< used on speech_worker; null: decisions are plain calls
  const std::unique_ptr<UtteranceService> elsewhere_;  ///< used on speech_worker; null: all is decided here

  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable work_changed_;
  std::condition_variable dictation_changed_;
  bool stopping_ = false;
  bool listening_;
  bool taking_ = false;  ///< sound: subscribed
  bool forget_ = false;  ///< what came before does not belong to what comes
  std::deque<Chunk> chunks_;
  double waiting_s_ = 0.0;  ///< of sound in chunks_
  Loaded next_;             ///< null: none
  AudioFormat format_;
  bool format_known_ = false;
  double without_info_s_ = 0.0;  ///< sound that was taken without
  RecognizerFigures figures_;    ///< as far as they are kept there
  std::deque<Samples> dictation_;
  bool dictation_ready_ = false;

  std::mutex check_mutex_;  ///< of these
  std::unique_ptr<SoundCheck> check_;
  SoundChange sound_;

  // speech_worker
  SoundStream stream_;
  std::unique_ptr<CommandRecognizer> recognizer_;  ///< null: none could be loaded yet
  int64_t recognizer_begin_ = 0;                   ///< sample of the stream that was its first
  Clock::time_point came_at_;                      ///< the message in work
  std::string frame_id_;
  bool forgetting_ = false;  ///< what is recognised is told to nobody
  std::vector<int16_t> raw_;
  Samples samples_;
  // speech_loader
  Source asked_for_;
  // speech_service
  bool subscribed_ = false;
  ros::Subscriber audio_;
  ros::Subscriber info_;

  ros::Publisher command_;
  ros::Publisher output_;
  ros::Publisher rejected_;
  ros::Publisher written_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer timer_;
  std::thread worker_;
  std::thread dictation_thread_;
};

}  // namespace pi_speech
