#pragma once

#include "decision/reaction_rules.h"
#include "ros/decision_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// Runs ReactionRules on the graph. Subscribes `obstacles` (pi_detect/ObstacleArray in base_link_frame);
/// publishes `motion/reaction` (pi_vehicle/MotionCommand: the speed limit, NO_SPEED_LIMIT if there is none) at a steady
/// rate and at once when the limit falls, `reaction/events` (pi_vehicle/ReactionEvent, one when a rule begins to act),
/// `say` (std_msgs/String), `horn` (std_msgs/Empty) and diagnostics. Private service `reload` (std_srvs/Trigger) reads
/// rules_file again; a wrong file changes nothing.
///
/// Rules run in the time of the obstacles' stamps. Obstacles whose stamp is older than obstacles_timeout, from the
/// future, out of order or in another frame are refused with a warning. Decisions: decision/reaction_rules.h.
/// One thread, `reaction`, has all callbacks.
class ReactionRos
{
public:
  /// Advertises, and begins to publish. @throws std::invalid_argument for wrong parameters or a wrong rules_file.
  ReactionRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~ReactionRos();
  ReactionRos(const ReactionRos&) = delete;
  ReactionRos& operator=(const ReactionRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void loadRules();
  void onObstacles(const pi_detect::ObstacleArray& message);
  bool onReload(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void run(const std_msgs::Header& header, const std::vector<SeenThing>& things);
  void act(const RuleEvent& event, const std_msgs::Header& header);
  bool silent(const ros::Time& now) const;
  void tick();
  void decide(const ros::Time& now, bool at_tick);
  void report(Status& status) const;

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  ros::NodeHandle private_node_;
  const ReactionRosOptions options_;
  const std::string rules_path_;
  ReactionRulesOptions rules_options_;
  std::unique_ptr<ReactionRules> rules_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;

  ros::Publisher motion_;
  ros::Publisher events_;
  ros::Publisher say_;
  ros::Publisher horn_;
  ros::Subscriber obstacles_;
  ros::ServiceServer reload_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer diagnostic_timer_;

  ros::Time newest_;  ///< stamp of the newest obstacles; zero: none yet
  ReactionResult result_;
  double limit_;        ///< as published last [m/s]
  std::string reason_;  ///< of it
  std::string last_event_;
  uint64_t arrays_ = 0;
  uint64_t refused_ = 0;
  uint64_t event_count_ = 0;
};

}  // namespace pi_vehicle
