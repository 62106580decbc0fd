#pragma once

#include "decision/pose_keeper.h"

#include <pi_node/ros/node_parameters.h>

#include <string>

namespace pi_vehicle
{

/// The parameters of the pose keeper; config/pose_keeper.yaml shows each with its unit.
struct PoseKeeperRosOptions : pi_node::NodeParameters<PoseKeeperRosOptions>
{
  PoseKeeperOptions keeper;
  std::string map_frame = "map";
  std::string base_link_frame = "base_link";
  std::string file;                 ///< that the pose is written to once per second; empty: none
  bool resume = false;              ///< begin with the pose of the file
  double max_file_age_s = 86400.0;  ///< older poses are not begun with [s]
  double diagnostic_period = 1.0;   ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;    ///< between two log lines of one warning [s]

  void setVehicle(const pi_node::VehicleDescription& vehicle) { keeper.limits = vehicle.limits; }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::PoseKeeperRosOptions>;
