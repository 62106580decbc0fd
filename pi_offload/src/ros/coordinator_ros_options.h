#pragma once

#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

#include "client/offload_client.h"
#include "engine/node.h"
#include "ros/answer_check.h"

namespace pi_offload
{

/// The weight of time against energy, by the state of the battery.
struct BatteryOptions
{
  double eta_full = 0.5;  ///< in [0, 1]
  double eta_empty = 0.1;
  double charge_full = 0.8;   ///< from here up eta_full, in [0, 1]
  double charge_empty = 0.2;  ///< up to here eta_empty; linear in between

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
  double eta(double charge) const;  ///< @param charge  0 to 1
};

/// The parameters of the coordinator node; config/coordinator.yaml shows each with its unit.
struct CoordinatorRosOptions : pi_node::NodeParameters<CoordinatorRosOptions>
{
  CoordinatorRosOptions();

  std::string vehicle;             ///< name at the nodes; empty: host name and the node's own
  std::string map_frame = "map";   ///< of the nodes' positions
  OffloadClientOptions client;     ///< work_gcycles follow from local_s below
  double detection_local_s = 0.1;  ///< of a detection on the vehicle until one is measured [s]
  double speech_local_s = 0.1;     ///< of an utterance on the vehicle [s]
  BatteryOptions battery;

  size_t max_local_waiting = 8;  ///< pictures waiting for the vehicle's detector
  double local_lost_s = 2.0;     ///< longest wait for the detector's answer [s]
  bool zero_copy = true;         ///< read pictures in shared memory, if the transport can
  double max_rate_hz = 0.0;      ///< of used pictures [Hz]; 0: no limit
  bool keep_order = true;        ///< of `detections`: a result waits for those of older pictures, to their deadline
  int max_calls = 4;             ///< of recognize_utterance at once; further ones get handled=false

  std::string nodes_file;              ///< YAML map file, absolute; empty: none
  std::vector<NodeDescription> nodes;  ///< more nodes
  bool announcements = true;           ///< use nodes announced on edge_nodes
  size_t max_nodes = 256;

  AnswerCheckOptions verify;

  bool always_on = false;           ///< work while nobody listens
  double odometry_timeout_s = 1.0;  ///< without odometry for longer, the position is unknown [s]
  double input_timeout_s = 2.0;     ///< without a picture for longer, there is a warning [s]
  double marker_rate_hz = 2.0;
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// The complete options of the client. @param vehicle  default name.
  OffloadClientOptions clientOptions(const std::string& vehicle) const;
};

}  // namespace pi_offload

extern template struct pi_node::NodeParameters<pi_offload::CoordinatorRosOptions>;
