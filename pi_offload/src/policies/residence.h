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

/// How long a vehicle is within a node's range. Times from now [s].
struct Residence
{
  double now_s = 0.0;     ///< usable now: until it leaves; 0 outside, infinite if it stands inside
  double enters_s = 0.0;  ///< start of the (next) window; 0 inside; infinite: never
  double leaves_s = 0.0;  ///< end of that window; infinite if it stands inside, 0 if there is none
  double window_s() const { return leaves_s > enters_s ? leaves_s - enters_s : 0.0; }
};

/// Equation 8 solved: straight on at constant speed.
/// @param heading  from the +Y axis (north), clockwise [rad]: the direction is (sin, cos), as in the paper.
/// @param speed    [m/s], at least 0.
/// @param range    [m], at least 0; infinite: everywhere inside. Exactly on the edge is inside, a tangent is not.
/// @throws std::invalid_argument naming the value, for other numbers that are not finite or out of range.
Residence straightResidence(const Point& vehicle, double heading, double speed, const Point& node, double range);

/// The heading of equation 8 for a yaw of REP 103 (from +X, counter-clockwise).
double headingOfYaw(double yaw);

/// Equation 8 read literally: the later solution, for a node ahead out of range too; negative or no solution (a vehicle
/// that stands has none): 0.
double printedResidence(const Point& vehicle, double heading, double speed, const Point& node, double range);

/// A place on a route.
struct RoutePlace
{
  size_t segment = 0;  ///< between points segment and segment + 1
  Point point;
};
/// The nearest place on the route that is not before `first_segment`; of several as near ones the first.
/// @param route  at least one point.
RoutePlace placeOnRoute(const Point& vehicle, const std::vector<Point>& route, size_t first_segment = 0);

/// The same along the planned route at constant speed: from the vehicle to its nearest point on the route, then along
/// it; behind its end the vehicle stands (infinite, if inside then). Times are those of the first window.
/// @param route          at least one point; the vehicle's place on it is the nearest one not before `first_segment`.
/// @param first_segment  less than the route's segments, or 0.
/// @throws std::invalid_argument naming the value, for an empty route and numbers out of range.
Residence routeResidence(const Point& vehicle, const std::vector<Point>& route, double speed, const Point& node,
                         double range, size_t first_segment = 0);

}  // namespace pi_offload
