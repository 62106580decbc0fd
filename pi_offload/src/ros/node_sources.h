#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_offload/EdgeNode.h>
#include <pi_offload/Nodes.h>
#include <pi_offload/RegisterNode.h>
#include <ros/ros.h>

#include <map>
#include <memory>
#include <string>

#include "client/offload_client.h"
#include "ros/answer_check.h"
#include "ros/coordinator_ros_options.h"
#include "ros/map_frame.h"

namespace pi_offload
{

/// Tells the engine which edge-cloud nodes there are: from the map file, the parameters, `edge_nodes`,
/// ~register_node, and what sites say of themselves at nats/servers. Runs on the service thread.
class NodeSources
{
public:
  /// Adds the nodes of the map file and of the parameters. @param options, client, checks, map, warnings  outlive
  /// this object.
  /// @throws std::runtime_error for the map file, std::invalid_argument for the nodes.
  NodeSources(ros::NodeHandle node, const CoordinatorRosOptions* options, OffloadClient* client, AnswerCheck* checks,
              MapFrame* map, pi_node::WarningBoard* warnings);

  /// Adds nodes whose frame tf has come to know. Call this regularly.
  void watch();
  bool nodes(Nodes::Request& request, Nodes::Response& response);
  bool registerNode(RegisterNode::Request& request, RegisterNode::Response& response);

private:
  void load();
  void onStatus(const NatsConnection::Message& message);
  void onEdgeNode(const EdgeNodeConstPtr& message);
  /// @param[out] problem  why the node cannot be used; empty if it can. @return false: tf does not know its frame yet.
  bool add(const EdgeNode& message, std::string* problem);
  void addToEngine(const NodeDescription& node, std::string* problem, int64_t now_ns);

  const CoordinatorRosOptions* const options_;
  OffloadClient* const client_;
  AnswerCheck* const checks_;  ///< of the engine thread
  MapFrame* const map_;
  pi_node::WarningBoard* const warnings_;
  std::map<std::string, EdgeNode> waiting_;  ///< nodes whose frame tf does not know yet
  ros::Subscriber announcements_;
  std::map<std::string, NodeDescription> sites_;  ///< as they announced themselves; of the thread of `directory_`
  std::unique_ptr<NatsConnection> directory_;
};

}  // namespace pi_offload
