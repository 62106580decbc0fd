#pragma once

#include "power/battery_estimator.h"
#include "power/power_account.h"
#include "power/service_meter.h"

#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

namespace pi_vehicle
{

/// The parameters of the power node; config/power.yaml shows each with its unit.
struct PowerRosOptions : pi_node::NodeParameters<PowerRosOptions>
{
  std::vector<power::ServiceDescription> services = power::defaultServices();
  double period_s = 1.0;             ///< between messages [s], in [0.1, 60]
  double memory_period_s = 5.0;      ///< between readings of memory [s]
  double lookup_period_s = 2.0;      ///< between searches for nodes that are not known [s]
  double lookup_timeout_s = 1.0;     ///< of the answer of master or node [s]
  std::vector<std::string> sensors;  ///< of the computer's watts; empty: found
  power::ModelOptions model;
  bool publish_battery = false;
  power::BatteryOptions battery;
  double vehicle_state_timeout_s = 2.0;  ///< [s]
  double diagnostic_period = 1.0;        ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;         ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::PowerRosOptions>;
