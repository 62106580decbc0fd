#pragma once

#include "decision/pose_keeper.h"

#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_vehicle
{

/// The parameters of the pose keeper; config/pose_keeper.yaml shows each with its unit.
struct PoseKeeperRosOptions
{
  PoseKeeperOptions keeper;
  std::string map_frame = "map";
  std::string base_link_frame = "base_link";
  std::string file;                 ///< that the pose is written to once per second; empty: none
  bool resume = false;              ///< begin with the pose of the file
  double max_file_age_s = 86400.0;  ///< older poses are not begun with [s]
  double diagnostic_period = 1.0;   ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;    ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static PoseKeeperRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static PoseKeeperRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                             std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_vehicle
