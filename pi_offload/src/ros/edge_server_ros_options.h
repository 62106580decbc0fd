#pragma once

#include <pi_node/ros/node_parameters.h>
#include <pi_offload/EdgeNode.h>

#include <array>
#include <string>
#include <vector>

#include "ros/range.h"
#include "server/edge_server.h"
#include "server/executors.h"
#include "server/health_endpoint.h"

namespace pi_offload
{

/// The parameters of the edge_server, from ROS or from a YAML file; config/edge_server.yaml shows each with its unit.
struct EdgeServerRosOptions : pi_node::NodeParameters<EdgeServerRosOptions>
{
  EdgeServerRosOptions();

  std::string id;                 ///< of the node; empty: the host's name
  std::string address;            ///< host:port for vehicles; empty: name of the host and port
  std::string map_frame = "map";  ///< of the position
  Range range;
  int port = 0;                       ///< to listen at; 0: any free one
  size_t max_payload_mb = 256;        ///< of all tasks queued and running [MiB]
  EdgeServerOptions server;           ///< the rest; see serverOptions()
  bool detection = true;              ///< serve pictures
  DetectionExecutorOptions detector;  ///< model: name or absolute path
  bool speech = true;                 ///< serve utterances
  SpeechExecutorOptions recognizer;
  std::string commands;                     ///< YAML file, absolute path; empty: pi_speech's
  bool health = true;                       ///< the HTTP endpoint
  int health_port = 0;                      ///< 0: any free one
  HealthEndpoint::Options health_endpoint;  ///< the rest; see healthOptions()
  double drain_s = 10.0;                    ///< longest wait for tasks under way at the end [s]
  double diagnostic_period = 1.0;           ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;            ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// The complete options of the server.
  EdgeServerOptions serverOptions() const;
  HealthEndpoint::Options healthOptions() const;
  /// Loads the descriptions of the models. Empty: not served.
  /// @throws std::invalid_argument, std::runtime_error naming the wrong file and the way out.
  std::array<ExecutorFactory, TASK_KINDS> executors() const;
  /// Name of the detector's network, for EdgeServerOptions::model; empty: pictures are not served.
  /// @param[out] notice  why it stands in for another network; untouched: it does not.
  /// @throws as executors().
  std::string detectionModel(std::string* notice) const;
  /// The announcement for vehicles. @param port  of the server.
  EdgeNode announcement(uint16_t port) const;

  /// Reads a YAML file. @throws std::runtime_error naming file, key, value and bound.
  static EdgeServerRosOptions loadFile(const std::string& path, std::vector<std::string>* unknown);
};

}  // namespace pi_offload

extern template struct pi_node::NodeParameters<pi_offload::EdgeServerRosOptions>;
