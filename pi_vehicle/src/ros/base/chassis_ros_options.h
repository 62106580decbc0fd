#pragma once

#include "ros/base/base_options.h"

#include <pi_node/ros/node_parameters.h>
#include <pi_vehicle/chassis/chassis_driver.h>

#include <string>

namespace pi_vehicle
{

/// The parameters of the chassis node; config/chassis.yaml shows each with its unit.
struct ChassisRosOptions : pi_node::NodeParameters<ChassisRosOptions>
{
  chassis::DriverOptions driver;
  WheelOdometryOptions wheels;
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]
  pi_node::VehicleDescription vehicle;

  void setVehicle(const pi_node::VehicleDescription& description)
  {
    vehicle = description;
    driver.host.limits = chassis::limitsOf(vehicle.limits);
  }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::ChassisRosOptions>;
