#pragma once

#include <pi_bringup/pacer.h>
#include <ros/ros.h>

#include <cstdint>
#include <map>
#include <string>

namespace pi_bringup
{

/// The latched topic ~status (diagnostic_msgs/DiagnosticStatus) of a player: message "waiting", "playing" or
/// "finished", and as values the messages published per resolved topic, skipped pictures and lateness. One thread.
class PlaybackStatus
{
public:
  PlaybackStatus(ros::NodeHandle& private_node, const std::string& player);

  void waiting() { publish("waiting"); }
  void playing() { publish("playing"); }
  /// Also logs the figures.
  void finished();

  /// Counts one published message and how late it was [ns].
  void count(const ros::Publisher& publisher, int64_t lateness_ns);
  /// Counts a picture left out; warns about the first one with its reason.
  void skip(const std::string& reason);

private:
  void publish(const std::string& state);

  const std::string player_;
  ros::Publisher publisher_;
  std::map<std::string, uint64_t> published_;
  uint64_t skipped_ = 0;
  LatenessStatistics lateness_;
};

}  // namespace pi_bringup
