#pragma once

#include <map>
#include <string>

namespace pi_node
{

enum class VehicleKind
{
  ACKERMANN,
  DIFFERENTIAL
};
const char* toString(VehicleKind kind);  ///< "ackermann", "differential"

/// Outline of the vehicle on the ground, in base_link.
struct Footprint
{
  double front = 1.0;       ///< ahead of base_link [m]
  double rear = 0.5;        ///< behind it [m]
  double half_width = 0.6;  ///< [m]
  double height = 1.6;      ///< the vehicle passes below what hangs higher [m]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// What the vehicle can do. Services may stay below.
struct MotionLimits
{
  double speed = 3.0;                   ///< forwards [m/s]
  double reverse_speed = 1.0;           ///< backwards [m/s]; 0: never
  double acceleration = 1.0;            ///< [m/s^2]
  double deceleration = 1.0;            ///< usual [m/s^2]
  double emergency_deceleration = 2.5;  ///< the hardest [m/s^2]
  double curvature = 0.45;              ///< [1/m]
  double curvature_rate = 0.8;          ///< [1/(m s)]
  double lateral_acceleration = 2.0;    ///< in bends [m/s^2]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Pose of a sensor in base_link. Of a camera: of a body that looks along x with z up.
struct Mount
{
  double x = 0.0;  ///< [m]
  double y = 0.0;
  double z = 0.0;
  double roll = 0.0;  ///< [rad]
  double pitch = 0.0;
  double yaw = 0.0;
};

/// The vehicle, described once; config/vehicle.yaml shows each field, and the defaults are the example vehicle there.
/// base_link is on the ground, in the middle of the rear axle or of the only axle; x is forward. Nodes get the
/// description from the parameter server: ros/vehicle_parameters.h.
struct VehicleDescription
{
  std::string name = "example";
  VehicleKind kind = VehicleKind::ACKERMANN;
  double wheelbase = 0.75;    ///< between the axles [m]; 0 for a differential vehicle
  double track = 0.9;         ///< between the wheels of an axle [m]
  double wheel_radius = 0.2;  ///< [m]
  double wheel_width = 0.1;   ///< [m]
  Footprint footprint;
  MotionLimits limits;
  int picture_width = 640;   ///< of the cameras [px]
  int picture_height = 480;  ///< [px]
  std::map<std::string, Mount> mounts = {{"imu_link", {0.8, 0.0, 1.0}},
                                         {"left_optical", {0.8, 0.06, 1.0}},
                                         {"right_optical", {0.8, -0.06, 1.0}}};  ///< by frame

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
  /// @throws std::invalid_argument naming the frame if it has no mount.
  const Mount& mount(const std::string& frame) const;
};

}  // namespace pi_node
