#pragma once

#include "ros/simulated_microphone_ros_options.h"
#include "vehicle/microphone_mixer.h"

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_simulation/SimulatorCommand.h>
#include <pi_speech/AudioInfo.h>
#include <ros/ros.h>
#include <std_msgs/String.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_simulation
{

/// Simulates a microphone that records noise and played sounds. Publishes `audio_stamped` and latched `audio_info` like
/// MicrophoneRos of pi_speech: SAMPLE_RATE_HZ, one channel, 20 ms per message, each when its last sample would have
/// been recorded. `~play` (std_msgs/String) names a sound file that is mixed in from the next message on; `~played`
/// (PlayedSound) tells when. A file that cannot be read is an error in the log.
///
/// The service `~command` (SimulatorCommand) makes faults. After `unplug` nothing is published until `plug`, and sounds
/// played meanwhile are lost; `silent on|off` gives samples of 0, like a muted microphone. `~played` is always
/// published.
///
/// After a pause of more than 1 s, for example of a stopped process, the stream continues with a gap in its stamps.
///
/// Two threads: `sim_microphone` mixes and publishes, `sim_mic_ros` has callbacks and reads files.
class SimulatedMicrophoneRos
{
public:
  /// @throws std::invalid_argument for wrong parameters, std::runtime_error for a background that cannot be used.
  SimulatedMicrophoneRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~SimulatedMicrophoneRos();
  SimulatedMicrophoneRos(const SimulatedMicrophoneRos&) = delete;
  SimulatedMicrophoneRos& operator=(const SimulatedMicrophoneRos&) = delete;

private:
  struct Sound
  {
    std::string file;
    pi_speech::Samples samples;
  };

  // sim_mic_ros
  void onPlay(const std_msgs::String& message);
  bool onCommand(SimulatorCommand::Request& request, SimulatorCommand::Response& response);
  /// @return the problem with its remedy; empty: done.
  std::string execute(const std::string& line);

  // sim_microphone
  void run();
  bool waitForTime();
  /// @return false: stopping.
  bool waitUntil(int64_t due_ns);
  void beginStream();
  void beginSounds();
  void send();
  ros::Time stampOf(int64_t sample) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  ros::NodeHandle service_private_node_;
  const SimulatedMicrophoneRosOptions options_;
  ros::Publisher audio_;
  pi_node::LatchedPublisher<pi_speech::AudioInfo> info_;
  ros::Publisher played_;
  ros::Subscriber play_;
  ros::ServiceServer command_;
  std::atomic<bool> plugged_{true};
  std::atomic<bool> silent_{false};

  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;        ///< under mutex_
  std::vector<Sound> requests_;  ///< under mutex_

  // sim_microphone
  MicrophoneMixer mixer_;
  int64_t begin_ns_ = 0;  ///< in the vehicle's time
  ros::Time begin_stamp_;
  int64_t begin_sample_ = 0;  ///< that begin_ns_ and begin_stamp_ are of
  std::thread thread_;
};

}  // namespace pi_simulation
