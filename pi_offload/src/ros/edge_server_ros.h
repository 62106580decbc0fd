#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include "server/edge_server.h"
#include "ros/edge_server_ros_options.h"
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <chrono>
#include <string>

namespace pi_offload
{

/// An edge-cloud node on a ROS graph: says where it is on `edge_nodes` (pi_offload/EdgeNode, latched), and how it is in
/// the diagnostics. Tasks do not come by ROS. One thread, `edge_server_ros`.
class EdgeServerRos
{
public:
  /// @param server, warnings  outlive this object.
  EdgeServerRos(ros::NodeHandle node, ros::NodeHandle private_node, const EdgeServerRosOptions& options,
                const EdgeServer* server, const pi_node::WarningBoard* warnings);
  ~EdgeServerRos();
  EdgeServerRos(const EdgeServerRos&) = delete;
  EdgeServerRos& operator=(const EdgeServerRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  void report(Status& status);

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const EdgeServerRosOptions options_;
  const EdgeServer* const server_;
  const pi_node::WarningBoard* const warnings_;
  diagnostic_updater::Updater updater_;
  EdgeServer::Statistics before_;  ///< at the previous update
  ros::Publisher announcement_;
  ros::WallTimer timer_;
};

}  // namespace pi_offload
