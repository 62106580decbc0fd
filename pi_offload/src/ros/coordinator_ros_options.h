#pragma once

#include "engine/node.h"
#include "client/offload_client.h"
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_offload
{

/// The weight of time against energy, by the state of the battery.
struct BatteryOptions
{
  double eta_full = 0.5;  ///< in [0, 1]
  double eta_empty = 0.1;
  double charge_full = 0.8;   ///< from this charge on eta_full, in [0, 1]
  double charge_empty = 0.2;  ///< up to this charge eta_empty; between the two eta is linear

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
  double eta(double charge) const;  ///< @param charge  0 to 1
};

/// The parameters of the coordinator node; config/coordinator.yaml shows each with its unit.
struct CoordinatorRosOptions
{
  CoordinatorRosOptions();

  std::string vehicle;             ///< name at the nodes; empty: host name and the node's own
  std::string map_frame = "map";   ///< of the nodes' positions
  OffloadClientOptions client;     ///< its work_gcycles follow from local_s below
  double detection_local_s = 0.1;  ///< a detection on the vehicle, until one was measured [s]
  double speech_local_s = 0.1;     ///< decoding an utterance on the vehicle [s]
  BatteryOptions battery;

  std::string local_model;       ///< network of the vehicle's detector; empty: as topic local/labels says
  size_t max_local_waiting = 8;  ///< pictures that wait for the vehicle's detector
  double local_lost_s = 2.0;     ///< a picture that the detector did not answer for so long is given up [s]
  bool zero_copy = true;         ///< pictures are read where their publisher wrote them, if the transport can
  double max_rate_hz = 0.0;      ///< pictures that come faster are left out [Hz]; 0: none is
  bool keep_order = true;        ///< of `detections`: stamps never go back; late pictures are dropped
  int max_calls = 4;             ///< of recognize_utterance at a time; further ones are answered handled=false

  std::string nodes_file;              ///< YAML map file, absolute; empty: none
  std::vector<NodeDescription> nodes;  ///< besides
  bool announcements = true;           ///< also those announced on edge_nodes
  size_t max_nodes = 256;

  bool always_on = false;           ///< also while nobody listens
  double odometry_timeout_s = 1.0;  ///< without odometry, after which the position counts as unknown [s]
  double input_timeout_s = 2.0;     ///< without a picture, after which there is a warning [s]
  double marker_rate_hz = 2.0;
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// The client's options, complete. @param vehicle  name where none is given.
  OffloadClientOptions clientOptions(const std::string& vehicle) const;

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static CoordinatorRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static CoordinatorRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                              std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_offload
