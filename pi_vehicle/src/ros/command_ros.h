#pragma once

#include "decision/command_actions.h"
#include "ros/decision_ros_options.h"
#include "ros/kept_parameters.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_vehicle/CommandState.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <string>

namespace pi_vehicle
{

/// Spoken commands on the graph. Subscribes `command` and `doubtful_command` (pi_speech/VoiceCommand; the end of the
/// speech is when it was spoken) and `vehicle_state`: a doubtful stop counts only while the vehicle moves. Publishes
/// `motion/command` (pi_vehicle/MotionCommand: the speed limit, 0 while a stop is latched) at a steady rate and at once
/// when it changes, `command/state` (pi_vehicle/CommandState, latched), `goal` (geometry_msgs/PoseStamped), `turn`
/// (std_msgs/String: left, right), `say` (std_msgs/String), `horn` (std_msgs/Empty) and diagnostics. Private services
/// `stop` and `release` (std_srvs/Trigger) are the latch by button.
///
/// The latch and the speed limit are kept in the private parameters `latched` and `kept_speed_limit`, so that they
/// outlive a node that is killed. Decisions: decision/command_actions.h. One thread, `command`, has all callbacks.
class CommandRos
{
public:
  /// Advertises, and begins to publish. @throws std::invalid_argument for wrong parameters or a wrong actions_file.
  CommandRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~CommandRos();
  CommandRos(const CommandRos&) = delete;
  CommandRos& operator=(const CommandRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void restore();
  void onCommand(const pi_speech::VoiceCommand& message);
  void onDoubtful(const pi_speech::VoiceCommand& message);
  bool moving(const ros::Time& now) const;
  void handle(const std::string& text, const CommandResult& result, const ros::Time& now);
  bool onStop(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onRelease(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void act(const CommandResult& result, const ros::Time& now);
  void say(const std::string& text);
  void tick();
  void publishMotion(const ros::Time& now);
  void publishState(const ros::Time& now, const std::string& text, const std::string& outcome,
                    const std::string& reason);
  void report(Status& status) const;

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  ros::NodeHandle private_node_;
  const CommandRosOptions options_;
  const std::string actions_path_;
  CommandActions actions_;
  pi_node::WarningBoard warnings_;
  KeptParameters kept_;
  diagnostic_updater::Updater updater_;

  ros::Publisher motion_;
  pi_node::LatchedPublisher<CommandState> state_publisher_;
  ros::Publisher goal_;
  ros::Publisher turn_;
  ros::Publisher say_;
  ros::Publisher horn_;
  ros::Subscriber command_;
  ros::Subscriber doubtful_;
  ros::Subscriber vehicle_state_;
  ros::ServiceServer stop_;
  ros::ServiceServer release_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer diagnostic_timer_;

  std::string stop_reason_;  ///< why the latch holds
  bool doubted_ = false;     ///< at the last tick
  ros::Time standing_at_;    ///< when the vehicle was last known to stand; 0: it moves, or nothing is known
  CommandState state_;
  uint64_t done_ = 0;
  uint64_t ignored_ = 0;
};

}  // namespace pi_vehicle
