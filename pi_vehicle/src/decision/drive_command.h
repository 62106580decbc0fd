#pragma once

#include <string>

namespace pi_vehicle
{

/// What the vehicle is asked to do: the fields of the message MotionCommand, without its header.
struct DriveCommand
{
  double speed = 0.0;             ///< forward positive [m/s]
  double curvature = 0.0;         ///< of the path of base_link's origin, left positive [1/m]
  double max_deceleration = 0.0;  ///< [m/s^2]; 0: the usual one
  std::string source;             ///< who asks
  std::string reason;             ///< why, for people
};

}  // namespace pi_vehicle
