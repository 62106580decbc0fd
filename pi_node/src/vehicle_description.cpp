#include "pi_node/vehicle_description.h"

#include "pi_node/option_check.h"

#include <cmath>
#include <stdexcept>

namespace pi_node
{

const char* toString(VehicleKind kind)
{
  return kind == VehicleKind::ACKERMANN ? "ackermann" : "differential";
}

void Footprint::validate() const
{
  const OptionCheck check("footprint");
  check.range("front", front, 0.05, 10.0);
  check.range("rear", rear, 0.05, 10.0);
  check.range("half_width", half_width, 0.05, 5.0);
  check.range("height", height, 0.1, 5.0);
}

void MotionLimits::validate() const
{
  const OptionCheck check("limits");
  check.range("speed", speed, 0.1, 10.0);
  check.range("reverse_speed", reverse_speed, 0.0, 10.0);
  check.range("acceleration", acceleration, 0.05, 10.0);
  check.range("deceleration", deceleration, 0.1, 10.0);
  check.range("emergency_deceleration", emergency_deceleration, deceleration, 20.0, "limits/deceleration");
  check.range("curvature", curvature, 0.01, 3.0);
  check.range("curvature_rate", curvature_rate, 0.01, 1000.0);
  check.range("lateral_acceleration", lateral_acceleration, 0.05, 20.0);
}

void VehicleDescription::validate() const
{
  if (name.empty() ||
      name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") != std::string::npos)
  {
    throw std::invalid_argument("name = \"" + name + "\", must be letters, digits and underscores");
  }
  footprint.validate();
  limits.validate();
  const OptionCheck check("");
  if (kind == VehicleKind::ACKERMANN)
  {
    check.range("wheelbase", wheelbase, 0.05, footprint.front, "footprint/front");
  }
  else
  {
    check.range("wheelbase", wheelbase, 0.0, 0.0, "kind is differential");
  }
  check.range("track", track, 0.05, 2.0 * footprint.half_width, "twice footprint/half_width");
  check.range("wheels/radius", wheel_radius, 0.01, 1.0);
  check.range("wheels/width", wheel_width, 0.005, 1.0);
  check.range("pictures/width", picture_width, 64, 4096);
  check.range("pictures/height", picture_height, 64, 4096);
  for (const auto& [frame, mount] : mounts)
  {
    const OptionCheck own("mounts/" + frame);
    own.range("x", mount.x, -10.0, 10.0);
    own.range("y", mount.y, -10.0, 10.0);
    own.range("z", mount.z, -10.0, 10.0);
    own.range("roll", mount.roll, -M_PI, M_PI);
    own.range("pitch", mount.pitch, -M_PI, M_PI);
    own.range("yaw", mount.yaw, -M_PI, M_PI);
  }
}

const Mount& VehicleDescription::mount(const std::string& frame) const
{
  const auto found = mounts.find(frame);
  if (found == mounts.end())
  {
    throw std::invalid_argument("vehicle/mounts/" + frame + " is missing");
  }
  return found->second;
}

}  // namespace pi_node
