#pragma once

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/AudioDataStamped.h>
#include <ros/ros.h>
#include <std_srvs/Empty.h>

#include <memory>
#include <string>
#include <vector>

#include "ros/command_loader.h"
#include "ros/dictation.h"
#include "ros/recognizer_diagnostics.h"
#include "ros/recognizer_ros_options.h"
#include "ros/recognizer_worker.h"

namespace pi_speech
{

/// Spoken commands on the graph.
///
/// Inputs are those of audio_capture: `audio_stamped` (pi_speech/AudioDataStamped) or `audio` (pi_speech/AudioData),
/// and `audio_info` (pi_speech/AudioInfo). Outputs: accepted commands on `command` (pi_speech/VoiceCommand) and
/// `recognizer/output` (std_msgs/String), commands that were perhaps said on `doubtful_command` (VoiceCommand), these
/// and other utterances on `~rejected` (VoiceCommand), and the text of other speech on `dictation` (std_msgs/String),
/// if asked for. Services: `~start`, `~stop`, `~set_commands`.
///
/// VoiceCommand.latency is the sound between the end of the speech and the end of the message that led to the decision,
/// plus the time from the arrival of that message to publication, by a monotonic clock. The latency does not depend on
/// stamps, so it holds for recordings, too. The time that sound takes to arrive is not part of it.
///
/// Threads: `speech_input` receives sound; `speech_worker` recognises (RecognizerWorker); `speech_loader` loads tables
/// and models (CommandLoader); `speech_service` takes start and stop, watches subscribers, and publishes diagnostics;
/// `speech_dictate`, if asked for, writes down (Dictation).
///
/// With utterance_service each utterance is first offered to that service, such as pi_offload/coordinator. Utterances
/// that the service does not handle in time are recognised here.
///
/// If a model or table cannot be used, log and diagnostics show an error; the node stays, and set_commands tries again.
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
  // speech_input
  void take(const AudioDataConstPtr& audio, const std_msgs::Header& header);

  // speech_worker
  void publish(const VoiceCommand& message, const Recognition& recognition, double latency_s);

  // speech_service
  bool listen(bool wanted);
  void updateSubscription();
  void publishDiagnostics();

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle input_node_;
  ros::NodeHandle service_node_;
  ros::NodeHandle private_node_;
  const RecognizerRosOptions options_;
  const std::string topic_;  ///< of the sound
  pi_node::WarningBoard warnings_;
  RecognizerDiagnostics diagnostics_;
  RecognizerWorker worker_;
  CommandLoader loader_;
  std::unique_ptr<Dictation> dictation_;  ///< null: not asked for

  // speech_service
  bool listening_;
  bool subscribed_ = false;
  ros::Subscriber audio_;
  ros::Subscriber info_;

  ros::Publisher command_;
  ros::Publisher output_;
  ros::Publisher doubtful_;
  ros::Publisher rejected_;
  ros::Publisher written_;
  std::vector<ros::ServiceServer> services_;
  pi_node::VehicleTimer timer_;
};

}  // namespace pi_speech
