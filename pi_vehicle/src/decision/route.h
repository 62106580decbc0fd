#pragma once

#include "decision/path.h"

#include <pi_node/vehicle_description.h>

#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

struct RouteOptions
{
  double min_radius = 1.0 / pi_node::MotionLimits().curvature;  ///< of the vehicle [m]
  double preferred_radius = 3.0;  ///< of corners, where the legs and the corridor allow it [m]
  double corridor = 1.5;          ///< largest distance between a corner and the path [m]
  double transition = 1.0;        ///< length over which curvature changes at the ends of an arc [m]
  double spacing = 0.1;           ///< of the path's points [m]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.preferred_radius, o.transition, void())
{
  visit("preferred_radius", o.preferred_radius);
  visit("corridor", o.corridor);
  visit("transition", o.transition);
  visit("spacing", o.spacing);
}

struct RouteRequest
{
  std::vector<Eigen::Vector2d> points;  ///< start, waypoints, goal, in the map [m]; neighbours closer than 5 cm are one
  std::optional<double> start_heading;  ///< [rad]; none: as the first leg
  std::optional<double> goal_heading;   ///< [rad]; none: as the last leg
  bool loop = false;                    ///< back to the first point and round again; headings must not be given
};

struct RouteResult
{
  std::optional<Path> path;    ///< nullopt: no path, see `problem`
  std::string problem;         ///< with the remedy; empty: none
  double max_curvature = 0.0;  ///< [1/m]
};

/// Plans a path that a vehicle with a turning circle can drive forwards. Corners become arcs, as wide as the legs, the
/// corridor and preferred_radius allow. Start and goal headings are reached by Dubins paths (Dubins 1957) that join the
/// leg where the whole route is shortest. Averaging over `transition` makes the curvature change linearly at the ends
/// of arcs, as in a clothoid. The turns at start and goal may leave the legs by up to four radii; obstacles are not
/// considered. There is no path, and `problem` says why, for fewer than 2 different points (loop: 3), more than 1000,
/// numbers that are not finite, and a corner that is too sharp for the corridor or whose legs are too short.
/// @throws std::invalid_argument from options.validate().
RouteResult planRoute(const RouteRequest& request, const RouteOptions& options = RouteOptions());

/// From a pose beside the path, or turned away from it, back onto the path and to its end (closed: one round).
/// @param ahead  farthest place of the path to join, ahead of the nearest one [m].
RouteResult rejoinRoute(const Path& path, const Pose2& pose, double ahead = 15.0,
                        const RouteOptions& options = RouteOptions());

/// The shortest path of three arcs of `radius` or straights between two poses; points every `spacing`, both ends
/// included. @return its length [m]. @param[out] points  may be nullptr.
double dubins(const Pose2& from, const Pose2& to, double radius, double spacing, std::vector<Eigen::Vector2d>* points);

}  // namespace pi_vehicle
