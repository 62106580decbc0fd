#pragma once

#include "ros/simulated_microphone_ros_options.h"
#include "vehicle/microphone_mixer.h"

#include <pi_node/ros/callback_thread.h>
#include <pi_simulation/SimulatorCommand.h>
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

/// A microphone that hears noise, and what it is told to play: `audio_stamped` and latched `audio_info` as pi_speech's
/// MicrophoneRos, at SAMPLE_RATE_HZ in one channel, 20 ms in a message, each when its last sample would have been
/// recorded. `~play` (std_msgs/String) names a sound file that is mixed in from the next message on; `~played`
/// (PlayedSound) says when. A file that cannot be read is an error in the log.
///
/// Service `~command` (SimulatorCommand) makes faults: `unplug` and `plug`: nothing is published, and what is played
/// meanwhile is lost; `silent on|off`: samples of 0, as of a muted microphone. `~played` is said in any case.
///
/// After a pause of more than a second, as of a stopped process, the stream goes on with a gap in its stamps.
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
  using Clock = std::chrono::steady_clock;

  struct Sound
  {
    std::string file;
    pi_speech::Samples samples;
  };

  // sim_mic_ros
  void onPlay(const std_msgs::String& message);
  bool onCommand(SimulatorCommand::Request& request, SimulatorCommand::Response& response);
  /// @return what is wrong with the line and what would be right; empty: done.
  std::string execute(const std::string& line);

  // sim_microphone
  void run();
  bool waitForTime();
  /// @return false: stopping.
  bool waitUntil(Clock::time_point due);
  void beginStream();
  void beginSounds();
  void send();
  ros::Time stampOf(int64_t sample) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  ros::NodeHandle service_private_node_;
  const SimulatedMicrophoneRosOptions options_;
  ros::Publisher audio_;
  ros::Publisher info_;
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
  Clock::time_point begin_;
  ros::Time begin_stamp_;
  int64_t begin_sample_ = 0;  ///< that begin_ and begin_stamp_ are of
  std::thread thread_;
};

}  // namespace pi_simulation
