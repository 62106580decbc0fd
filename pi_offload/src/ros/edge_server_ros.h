#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/warning_board.h>
#include <pi_offload/EdgeNode.h>
#include <ros/ros.h>

#include <chrono>
#include <string>

#include "ros/edge_server_ros_options.h"
#include "server/edge_server.h"

namespace pi_offload
{

/// Announces an edge server on `edge_nodes` (pi_offload/EdgeNode, latched) and publishes its diagnostics. Tasks do not
/// come by ROS. Has one thread, `edge_server_ros`.
class EdgeServerRos
{
public:
  /// @param server, warnings  outlive this object.
  /// @param network  of the detector; empty: pictures are not served.
  EdgeServerRos(ros::NodeHandle node, ros::NodeHandle private_node, const EdgeServerRosOptions& options,
                const EdgeServer* server, const std::string& network, const pi_node::WarningBoard* warnings);
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
  pi_node::LatchedPublisher<EdgeNode> announcement_;
  ros::WallTimer timer_;
};

}  // namespace pi_offload
