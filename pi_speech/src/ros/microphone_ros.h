#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include "audio/microphone.h"
#include "ros/microphone_ros_options.h"
#include "audio/sound_check.h"
#include <ros/ros.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

namespace pi_speech
{

/// A microphone on the graph: `audio_stamped` (pi_speech/AudioDataStamped, one per period, stamped with when its first
/// sample was recorded) and latched `audio_info` (pi_speech/AudioInfo: what the device really gives), as audio_capture
/// has them.
///
/// Two threads: `microphone` records and publishes; `mic_service` publishes diagnostics. A device that cannot be
/// opened, or goes, is one error in the log and stays in the diagnostics; the node stays, and tries again until it is
/// there.
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
  void reportSound(Status& status);

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  const MicrophoneRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  ros::Publisher audio_;
  ros::Publisher info_;
  ros::WallTimer timer_;

  // microphone
  AudioFormat published_format_;
  bool format_published_ = false;

  std::mutex mutex_;  ///< of all below; held briefly
  SoundCheck check_;
  SoundChange sound_;  ///< as it is

  // mic_service
  MicrophoneStatus status_;  ///< at this update
  uint64_t overruns_warned_ = 0;

  std::unique_ptr<Microphone> microphone_;
};

}  // namespace pi_speech
