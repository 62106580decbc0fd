#pragma once

#include <cstddef>
#include <vector>

namespace pi_offload
{

/// Position in the map [m].
struct Point
{
  double x = 0.0;
  double y = 0.0;
};

/// When a vehicle is within a node's range. Times from now [s].
struct Residence
{
  double now_s = 0.0;     ///< time until it leaves; 0 outside, infinite if it stands inside
  double enters_s = 0.0;  ///< start of the (next) window; 0 inside; infinite: never
  double leaves_s = 0.0;  ///< end of that window; infinite if it stays inside, 0 if there is none
  double window_s() const { return leaves_s > enters_s ? leaves_s - enters_s : 0.0; }
};

/// The point of the line from `from` to `to` that is nearest to `p`.
Point nearestOf(const Point& from, const Point& to, const Point& p);

/// Solution of equation 8: straight on at constant speed.
/// @param heading  from the +Y axis (north), clockwise [rad]: the direction is (sin, cos), as in the paper.
/// @param speed    [m/s], at least 0.
/// @param range    [m], at least 0; infinite: everywhere inside. Exactly on the edge is inside, a tangent is not.
/// @throws std::invalid_argument naming a value that is not finite or out of range.
Residence straightResidence(const Point& vehicle, double heading, double speed, const Point& node, double range);

/// The heading of equation 8 for a yaw of REP 103 (from +X, counter-clockwise).
double headingOfYaw(double yaw);

/// Equation 8 read literally: the later solution, also for a node that is still out of range. 0 if the solution is
/// negative or missing (a standing vehicle has none).
double printedResidence(const Point& vehicle, double heading, double speed, const Point& node, double range);

/// Residence along the planned route at constant speed: from the vehicle to the nearest point of the route, then along
/// it; the vehicle stops at its end. The times are those of the first window.
/// @param route  at least one point.
/// @throws std::invalid_argument for an empty route, or naming a value out of range.
Residence routeResidence(const Point& vehicle, const std::vector<Point>& route, double speed, const Point& node,
                         double range);

}  // namespace pi_offload
