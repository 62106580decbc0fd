#pragma once

#include "decision/pose_keeper.h"
#include "ros/pose_keeper_ros_options.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_vehicle/LocalisationState.h>
#include <ros/ros.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <boost/shared_ptr.hpp>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace pi_vehicle
{

/// Runs the PoseKeeper on the graph.
///
/// Subscribes `odometry` (of the localisation), tf map -> odom, `wheel_odometry` (of the chassis). Publishes
/// `initialpose` (geometry_msgs/PoseWithCovarianceStamped in the map, at a stamp of odometry) after a restart of
/// odometry until odometry accepts it; `localisation` (LocalisationState, latched) at each change of `valid`, which is
/// false from silence_s of silence until odometry's pose in the map is right again, so that nobody drives by a wrong
/// pose; diagnostics.
///
/// All on one thread, `pose_keeper`; only the file is written there. Times are those of ros::Time.
class PoseKeeperRos
{
public:
  /// Advertises, and begins. @throws std::invalid_argument for wrong parameters. A file that cannot be used is warned
  /// of.
  PoseKeeperRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Writes the file.
  ~PoseKeeperRos();
  PoseKeeperRos(const PoseKeeperRos&) = delete;
  PoseKeeperRos& operator=(const PoseKeeperRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void onOdometry(const ros::MessageEvent<nav_msgs::Odometry const>& event);
  void onWheels(const nav_msgs::OdometryConstPtr& message);
  void lookUpMap(const nav_msgs::Odometry& odometry);
  uint64_t connectionOf(const ros::MessageEvent<nav_msgs::Odometry const>& event);
  void update();
  /// Publishes and logs what changed.
  void tell();
  void save();
  void report(Status& status) const;

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  const PoseKeeperRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  tf2_ros::Buffer tf_buffer_;
  PoseKeeper keeper_;

  /// The last connections of odometry with their numbers; kept so that no other connection gets the same address.
  std::vector<std::pair<boost::shared_ptr<ros::M_string>, uint64_t>> connections_;
  uint64_t last_connection_ = 0;
  int64_t map_looked_up_ns_ = 0;
  bool told_valid_ = false;
  KeeperState told_state_ = KeeperState::WAITING;
  std::unique_ptr<SavedPose> saved_;  ///< as it was written last
  std::string file_problem_;

  tf2_ros::TransformListener tf_listener_;
  ros::Publisher initial_pose_;
  pi_node::LatchedPublisher<LocalisationState> localisation_;
  ros::Subscriber odometry_;
  ros::Subscriber wheels_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer file_timer_;
  pi_node::VehicleTimer diagnostic_timer_;
};

}  // namespace pi_vehicle
