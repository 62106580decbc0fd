#pragma once

#include "recorder/incident_plan.h"
#include "recorder/message_memory.h"
#include "ros/recorder/disk_writer.h"
#include "ros/recorder/incident_triggers.h"
#include "ros/recorder/intake.h"
#include "ros/recorder/recorder_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/Incident.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// The black box. Keeps the newest messages of chosen topics in memory, writes a bag of each incident, from before its
/// trigger to after it, and continuous slim bags. Triggers: `arbiter/state`, `vehicle_state`, `motion`,
/// collision_topic, and the private service `save` (std_srvs/Trigger; `message` is the path of the bag). Publishes
/// `incident` (pi_vehicle/Incident, latched) and diagnostics.
///
/// Two threads: `recorder` takes messages, 20 times per second; `recorder_disk` writes them, four times per second.
class RecorderRos
{
public:
  /// Subscribes, and begins to record. @throws std::invalid_argument for wrong parameters.
  RecorderRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Writes what there is, and ends all files.
  ~RecorderRos();
  RecorderRos(const RecorderRos&) = delete;
  RecorderRos& operator=(const RecorderRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void subscribeTriggers();
  bool onSave(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void tick();
  int64_t elapsedNow();
  std::string trigger(const recorder::Trigger& trigger);
  void report(Status& status) const;

  pi_node::CallbackThread thread_;
  pi_node::CallbackThread disk_thread_;
  ros::NodeHandle node_;
  ros::NodeHandle disk_node_;
  ros::NodeHandle private_node_;
  const RecorderRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  recorder::MessageMemory memory_;
  recorder::IncidentPlan plan_;
  recorder::DiskWriter disk_;
  recorder::IncidentTriggers triggers_;
  recorder::Intake intake_;

  pi_node::LatchedPublisher<Incident> incident_;
  std::vector<ros::Subscriber> subscribers_;
  ros::ServiceServer save_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer disk_timer_;
  pi_node::VehicleTimer diagnostic_timer_;

  int64_t vehicle_ns_ = 0;  ///< at the last tick
  int64_t jumped_ns_ = 0;   ///< by which the clock went back so far
  Incident last_;
};

}  // namespace pi_vehicle
