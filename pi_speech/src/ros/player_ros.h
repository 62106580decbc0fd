#pragma once

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/audio.h>
#include <ros/ros.h>
#include "ros/player_ros_options.h"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

namespace pi_speech
{

/// Plays sound files with the topics of MicrophoneRos: `audio_stamped` and latched `audio_info`, at SAMPLE_RATE_HZ in
/// one channel. Each message is published when its last sample would have been recorded. Stamps count samples from the
/// first message on, also if `rate` is not 1.
///
/// Publishes the name of each file on latched `playing` (std_msgs/String), and at the end latched `finished`
/// (std_msgs/Empty). If a file cannot be read, the log shows an error and the next file is played.
///
/// Three threads: `player` plays, `player_reader` reads the next file, `player_links` learns of subscribers.
class PlayerRos
{
public:
  /// @throws std::invalid_argument for wrong parameters, std::runtime_error for a folder or list without files.
  PlayerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Ends playing at once; waits for a file that is being read.
  ~PlayerRos();
  PlayerRos(const PlayerRos&) = delete;
  PlayerRos& operator=(const PlayerRos&) = delete;

private:
  using Clock = std::chrono::steady_clock;

  struct File
  {
    std::string path;
    Samples samples;
    std::string problem;  ///< why it cannot be played
  };

  // player
  void play();
  bool waitForSubscriber();
  bool waitForTime();
  /// All files once. @return false: stopping, or none could be read.
  bool playRound();
  bool playFile(const File& file);
  /// @return false: stopping.
  bool add(const Samples& samples);
  bool send();
  std::future<File> read(const std::string& path) const;
  void makeGap();

  pi_node::CallbackThread links_thread_;
  ros::NodeHandle links_node_;
  const PlayerRosOptions options_;
  const std::vector<std::string> files_;
  ros::Publisher audio_;
  pi_node::LatchedPublisher<AudioInfo> info_;
  ros::Publisher playing_;
  ros::Publisher finished_;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;
  bool subscribed_ = false;

  // player
  Clock::time_point begin_;
  ros::Time begin_stamp_;
  uint64_t sent_ = 0;  ///< samples
  Samples message_;    ///< not full yet
  Samples gap_;
  std::set<std::string> unreadable_;  ///< said already
  uint64_t played_ = 0;               ///< files
  std::thread thread_;
};

}  // namespace pi_speech
