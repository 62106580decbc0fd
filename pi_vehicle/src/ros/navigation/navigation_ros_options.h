#pragma once

#include "decision/navigator.h"

#include <pi_node/ros/node_parameters.h>

#include <map>
#include <string>

namespace pi_vehicle
{

/// Where to drive by name: in the map, the heading may be left out.
using Places = std::map<std::string, Waypoint>;

/// The parameters of navigation; config/navigation.yaml shows each with its unit.
struct NavigationRosOptions : pi_node::NodeParameters<NavigationRosOptions>
{
  NavigatorOptions navigator;
  double rate_hz = 20.0;  ///< of motion/navigation
  std::string map_frame = "map";
  std::string base_link_frame = "base_link";
  double tf_timeout_s = 2.0;  ///< oldest tf from map to the frame of odometry; what is static is never too old
  Places places;
  double resume_goal_within_s = 10.0;  ///< after its death it drives on to its goal, if back within so long; 0: never
  double diagnostic_period = 1.0;      ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;       ///< between two log lines of one warning [s]

  void setVehicle(const pi_node::VehicleDescription& vehicle) { navigator.setVehicle(vehicle); }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::NavigationRosOptions>;
