#pragma once

#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

namespace pi_vehicle
{

/// The parameters of the recorder; config/recorder.yaml shows each with its unit.
struct RecorderRosOptions : pi_node::NodeParameters<RecorderRosOptions>
{
  std::string folder = "~/.ros/pi_edge/recordings";
  int memory_mb = 96;        ///< of all messages that are kept [10^6 bytes], in [1, 4000]
  double before_s = 60.0;    ///< of an incident before its trigger [s]
  double after_s = 15.0;     ///< of an incident after its last trigger [s]
  double longest_s = 300.0;  ///< of one incident [s], at least before_s + after_s
  int incidents_budget_mb = 8000;
  int min_free_mb = 200;  ///< space on the disk that is left to others
  std::vector<std::string> topics = {
      "imu/data",   "/tf",    "/tf_static", "left/camera_info", "right/camera_info", "tracks",
      "detections", "labels", "route"};
  std::vector<std::string> pictures = {"left/image_raw", "right/image_raw"};
  double picture_rate_hz = 2.0;  ///< of each topic of pictures, in [0.01, 60]
  int jpeg_quality = 80;         ///< in [1, 100]

  struct Slim
  {
    std::vector<std::string> topics = {
        "odometry",          "map_pose",        "localisation",   "wheel_odometry",  "vehicle_state",  "motion",
        "motion/navigation", "motion/reaction", "motion/command", "cmd_vel",         "remote/cmd_vel", "emergency_stop",
        "arbiter/state",     "command",         "command/state",  "reaction/events", "obstacles",      "goal",
        "drive/goal",        "drive/feedback",  "drive/result",   "battery",         "power",          "collision",
        "/diagnostics",      "/rosout_agg"};
    std::vector<std::string> thinned_topics = {"odometry", "map_pose", "wheel_odometry", "vehicle_state", "motion"};
    double thinned_hz = 20.0;  ///< of each of thinned_topics in the slim files
    double file_s = 600.0;     ///< duration of a file [s]
    int budget_mb = 2000;      ///< of all files
  } slim;

  double braking_deceleration = 2.0;  ///< a command to brake as hard is an incident [m/s^2]
  std::vector<std::string> take_over_sources = {"remote"};
  std::string collision_topic = "collision";
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::RecorderRosOptions>;
