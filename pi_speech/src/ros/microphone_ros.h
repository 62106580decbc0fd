#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/AudioInfo.h>
#include <ros/ros.h>
#include "audio/microphone.h"
#include "ros/microphone_ros_options.h"
#include "ros/sound_watch.h"

#include <cstdint>
#include <memory>
#include <string>

namespace pi_speech
{

/// A microphone on the graph, with the topics of audio_capture: `audio_stamped` (pi_speech/AudioDataStamped, one per
/// period; the stamp is the time of its first sample) and latched `audio_info` (pi_speech/AudioInfo: the format of the
/// device).
///
/// Two threads: `microphone` records and publishes; `mic_service` publishes diagnostics. If the device cannot be opened
/// or vanishes, the node logs one error, shows it in the diagnostics, and tries again until the device is there.
class MicrophoneRos
{
public:
  /// Advertises, and begins to record. @throws std::invalid_argument for wrong parameters.
  MicrophoneRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~MicrophoneRos();
  MicrophoneRos(const MicrophoneRos&) = delete;
  MicrophoneRos& operator=(const MicrophoneRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  // microphone
  void onFound(const std::string& device, const AudioFormat& format);
  void onLost(const std::string& problem);
  void onSound(const MicrophoneSound& sound);

  // mic_service
  void publishDiagnostics();
  void reportDevice(Status& status) const;
  void reportSound(Status& status) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  const MicrophoneRosOptions options_;
  pi_node::WarningBoard warnings_;
  SoundWatch watch_;
  diagnostic_updater::Updater updater_;
  ros::Publisher audio_;
  pi_node::LatchedPublisher<AudioInfo> info_;
  pi_node::VehicleTimer timer_;

  // microphone
  AudioFormat published_format_;
  bool format_published_ = false;

  // mic_service
  MicrophoneStatus status_;  ///< at this update
  uint64_t overruns_warned_ = 0;

  std::unique_ptr<Microphone> microphone_;
};

}  // namespace pi_speech
