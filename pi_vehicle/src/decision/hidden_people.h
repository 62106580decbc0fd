#pragma once

#include <pi_vehicle/decision/ground_polygon.h>
#include <pi_vehicle/decision/pose2.h>

#include <vector>

namespace pi_vehicle::hidden_people
{

/// Where a person comes into view from behind an obstacle beside the way.
struct Edge
{
  double distance = 0.0;  ///< along the way, from the vehicle's origin to the obstacle's far end; negative: behind [m]
  double gap = 0.0;       ///< between the obstacle and the strip that the vehicle drives over; negative: inside [m]
};

struct Vehicle
{
  double front = 1.0;                   ///< ahead of its origin [m]
  double deceleration = 1.0;            ///< to slow down for the edge [m/s^2]
  double emergency_deceleration = 2.5;  ///< once the person is seen [m/s^2]
  double brakes_delay = 0.35;           ///< until a lower limit acts [s]
  double reaction_time = 0.6;           ///< from where the person can be seen until the brakes act [s]
};

enum class Who
{
  NOBODY,
  CHILD,
  ADULT  ///< or child
};

/// Who can stand unseen behind an obstacle.
/// @param eye  place of the vehicle, in the frame of the outline. @param top  height above the ground [m].
Who behind(const GroundPolygon& outline, const Eigen::Vector2d& eye, double top);

/// @param way  poses that the vehicle will take, not empty, in the frame of the outline.
Edge edgeOf(const GroundPolygon& outline, const std::vector<Pose2>& way, double half_width);

/// The largest speed at which a person who steps out at `step_out_speed` when it is worst is not hit: the vehicle
/// either stops before the edge, or has slowed down to a walking person's touch (CONTACT_SPEED) when the person
/// reaches its strip,
///   v <= CONTACT_SPEED + emergency_deceleration * max(0, gap / step_out_speed - reaction_time).
/// Farther away it is the speed from which braking comfortably, after brakes_delay, ends in that one in time. Infinite
/// beside and behind the edge: who steps out there walks into the vehicle's side.
double allowedSpeed(const Edge& edge, double step_out_speed, const Vehicle& vehicle);

/// Across the line of sight: what is seen for a moment only may be a metre long along it, as far as is known.
bool isNotWiderThanPerson(const GroundPolygon& outline, const Eigen::Vector2d& eye);

/// Whether something that is seen for a moment only can be a person who has just come out from behind `hider`: of a
/// person's size, beyond the hider's far end, and on its way to the vehicle's, as far as its velocity is known.
/// @param velocity  over the ground, in the frame of the outlines [m/s]. @param way  not empty, begins at the vehicle.
bool comesOut(const GroundPolygon& seen, const Eigen::Vector2d& velocity, const GroundPolygon& hider,
              const std::vector<Pose2>& way);

/// Unit vector from a point beside the way towards it, across it.
Eigen::Vector2d towards(const std::vector<Pose2>& way, const Eigen::Vector2d& point);

}  // namespace pi_vehicle::hidden_people
