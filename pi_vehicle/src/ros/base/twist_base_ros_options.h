#pragma once

#include "chassis/twist_base.h"
#include "ros/base/base_options.h"

#include <pi_node/ros/node_parameters.h>

namespace pi_vehicle
{

/// The parameters of the twist_base node; config/twist_base.yaml shows each with its unit.
struct TwistBaseRosOptions : pi_node::NodeParameters<TwistBaseRosOptions>
{
  chassis::TwistBaseOptions base;
  WheelOdometryOptions wheels;
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  void setVehicle(const pi_node::VehicleDescription& vehicle)
  {
    base.limits = chassis::limitsOf(vehicle.limits);
    base.wheelbase = vehicle.wheelbase;
  }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::TwistBaseRosOptions>;
