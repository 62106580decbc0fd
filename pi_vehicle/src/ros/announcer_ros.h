#pragma once

#include "announcer/speech_synthesizer.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/node_parameters.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle
{

/// The parameters of the announcer node; config/announcer.yaml shows each with its unit.
struct AnnouncerRosOptions : pi_node::NodeParameters<AnnouncerRosOptions>
{
  std::string device = "default";
  std::string voice = "en-us";
  int words_per_minute = 160;
  double horn_s = 0.6;             ///< [s]
  int queue_size = 4;              ///< texts that wait
  double diagnostic_period = 1.0;  ///< [s]
  double warning_period_s = 5.0;   ///< [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Speaks what comes on `say` (std_msgs/String) and blows the horn for `horn` (std_msgs/Empty), one after the other,
/// the horn first; logs both. Without a sound device, or without espeak-ng, it says so once, and goes on logging; every
/// sound tries the device again. A node and no nodelet: espeak-ng has one state per process.
///
/// Two threads: `announcer` has callbacks and diagnostics, `announcer_sound` makes and plays sound.
class AnnouncerRos
{
public:
  /// @throws std::invalid_argument for wrong parameters.
  AnnouncerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Falls silent within a second.
  ~AnnouncerRos();
  AnnouncerRos(const AnnouncerRos&) = delete;
  AnnouncerRos& operator=(const AnnouncerRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void onSay(const std_msgs::String& message);
  void onHorn(const std_msgs::Empty& message);
  void report(Status& status);
  void run();
  void sound(bool horn, const std::string& text);

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const AnnouncerRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  ros::Subscriber say_;
  ros::Subscriber horn_;
  pi_node::VehicleTimer diagnostic_timer_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::string> texts_;
  bool horn_waits_ = false;
  std::string problem_;  ///< of the last sound; empty: it was heard
  uint64_t heard_ = 0;
  uint64_t unheard_ = 0;

  std::unique_ptr<SpeechSynthesizer> synthesizer_;  ///< announcer_sound; made for the first text
  std::atomic<bool> stopping_{false};
  std::thread sound_thread_;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::AnnouncerRosOptions>;
