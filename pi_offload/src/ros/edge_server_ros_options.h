#pragma once

#include <pi_offload/EdgeNode.h>
#include "server/edge_server.h"
#include "server/executors.h"
#include "server/health_endpoint.h"
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <array>
#include <limits>
#include <string>
#include <vector>

namespace pi_offload
{

/// Range of a node's network: a number, or "inf" in files and parameters [m].
struct Range
{
  double metres = std::numeric_limits<double>::infinity();
};

/// The parameters of the edge_server; config/edge_server.yaml shows each with its unit. The same as parameters of ROS
/// and as a YAML file.
struct EdgeServerRosOptions
{
  EdgeServerRosOptions();

  std::string id;                 ///< of the node; empty: the host's name
  std::string address;            ///< host:port that vehicles connect to; empty: that of the host, and the port
  std::string map_frame = "map";  ///< of the position
  Range range;
  int port = 0;                       ///< that it listens at, 0: any free one
  size_t max_payload_mb = 256;        ///< of all tasks queued and running [MiB]
  EdgeServerOptions server;           ///< the rest; see serverOptions()
  bool detection = true;              ///< pictures are worked on
  DetectionExecutorOptions detector;  ///< model: absolute; empty: pi_detect's
  bool speech = true;                 ///< utterances are worked on
  SpeechExecutorOptions recognizer;
  std::string commands;                     ///< YAML file, absolute; empty: pi_speech's
  bool health = true;                       ///< the HTTP endpoint
  int health_port = 0;                      ///< 0: any free one
  HealthEndpoint::Options health_endpoint;  ///< the rest; see healthOptions()
  double drain_s = 10.0;                    ///< longest wait for tasks that are under way, at the end [s]
  double diagnostic_period = 1.0;           ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;            ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// For the server, with all that follows from the rest.
  EdgeServerOptions serverOptions() const;
  HealthEndpoint::Options healthOptions() const;
  /// Loads the descriptions of the models; null: not served.
  /// @throws std::invalid_argument, std::runtime_error naming the file that is wrong, and the way out.
  std::array<ExecutorFactory, TASK_KINDS> executors() const;
  /// Name of the network that pictures are worked on with, for EdgeServerOptions::model; empty: none are.
  /// @throws as executors().
  std::string detectionModel() const;
  /// As it is announced. @param port  that the server listens at.
  EdgeNode announcement(uint16_t port) const;

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static EdgeServerRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// Reads a YAML file. @throws std::runtime_error naming file, key, value and bound.
  static EdgeServerRosOptions loadFile(const std::string& path, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static EdgeServerRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                             std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_offload
