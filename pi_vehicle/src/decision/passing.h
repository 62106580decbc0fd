#pragma once

#include "decision/ground_grid.h"
#include "decision/path.h"
#include "decision/speed_governor.h"

#include <pi_node/vehicle_description.h>

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

struct PassingOptions
{
  double left = 4.0;           ///< the vehicle's outline may use so much left of the route to pass; 0: never [m]
  double right = 1.0;          ///< likewise on the right [m]
  double hold_distance = 7.0;  ///< before what may be passed it waits, as it needs room to steer round it [m]
  double speed = 1.5;          ///< beside the route [m/s]
  double clearance = 0.5;      ///< to what stands, on the sides [m]
  double known_for = 1.0;      ///< what has stood, or was in the way, for less is not passed [s]
  double max_curvature = 0.3;  ///< of the way round [1/m]
  double seen = 0.9;           ///< part of the ground on the way round that must be seen to be free

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.hold_distance, o.known_for, void())
{
  visit("left", o.left);
  visit("right", o.right);
  visit("hold_distance", o.hold_distance);
  visit("speed", o.speed);
  visit("clearance", o.clearance);
  visit("known_for", o.known_for);
  visit("max_curvature", o.max_curvature);
  visit("seen", o.seen);
}

struct PassingInput
{
  int64_t now_ns = 0;
  Pose2 pose;          ///< T_map_base now
  double speed = 0.0;  ///< measured [m/s]
  std::vector<KnownObstacle> obstacles;
  const GroundGrid* ground = nullptr;  ///< around the vehicle; nullptr: nothing is seen
};

struct PassingOutput
{
  std::optional<Path> path;  ///< to be driven from now on: the route with a way round an obstacle
  double speed_limit = std::numeric_limits<double>::infinity();  ///< [m/s]
  int64_t obstacle_id = -1;                                      ///< that is passed, or blocks the way; -1: none
  std::string reason;                                            ///< for people; empty: nothing is passed or blocked
};

/// Finds the way round what stands on the route: beside it within what is allowed, where the ground was seen to be free
/// and nobody comes, and back behind it. Until there is one the vehicle waits at hold_distance. People and animals are
/// waited for. The way round is a sideways shift of the route whose second derivative is continuous (quintic, as in
/// Werling et al. 2010): the smallest one that keeps the clearance. It is looked for again where it turns out to be
/// blocked. Not thread safe.
class Passing
{
public:
  /// @throws std::invalid_argument from options.validate().
  Passing(const PassingOptions& options, const pi_node::Footprint& vehicle, const pi_node::MotionLimits& limits);

  /// @param route  to follow, in the map. Empty: as clear().
  void setRoute(const Path& route);
  void clear() { setRoute(Path()); }

  /// Call at 10 to 100 Hz while the vehicle is on the route, or on the path that this returned last.
  PassingOutput update(const PassingInput& input);

private:
  /// Sideways shift over the way along the route: from what it is now to `shift`, and back to 0.
  struct Detour
  {
    double begin = 0.0;  // on the route; the lengths are counted from here [m]
    double from = 0.0;   // shift at the begin, and its slope
    double slope = 0.0;
    double shift = 0.0;
    double shifted = 0.0;  // from here on [m]
    double back = 0.0;     // until here [m]
    double end = 0.0;      // on the route again [m]

    double at(double length) const;
    double slopeAt(double length) const;
  };
  struct Blocker
  {
    const KnownObstacle* obstacle = nullptr;
    double distance = 0.0;  // of the vehicle's way until it touches [m]
  };

  Pose2 placeOn(const Path& path, double s) const { return path.at(s).pose(); }
  Pose2 placeOn(const Detour& detour, double length) const;
  /// Of a place of the route, from the detour's begin on; of a closed one at most half of it either way.
  double lengthOn(const Detour& detour, double s) const;
  bool bendsTooMuch(const Detour& detour) const;
  bool touches(const KnownObstacle& obstacle, const Pose2& place, double clearance) const;
  PathProjection locate() const;
  Blocker firstBlocker() const;
  bool isClear(const Detour& detour, double from, double to, double clearance) const;
  std::string problemOf(const Detour& detour) const;
  /// @param blocked_at  the vehicle's way until it touches what is in the way [m].
  std::string findDetour(double blocked_at, Detour* found) const;
  Path pathOf(const Detour& detour) const;
  std::string describe(const KnownObstacle& obstacle) const;
  /// What is passed may turn out to be a person when the vehicle is nearer.
  void waitForPerson(PassingOutput* output) const;

  const PassingOptions options_;
  const pi_node::Footprint vehicle_;
  const pi_node::MotionLimits limits_;
  Path route_;
  Path path_;  // the route, with the present detour
  std::optional<Detour> detour_;
  int64_t passed_id_ = -1;
  int64_t blocker_id_ = -1;  // what is in the way; -1: nothing is
  int64_t blocked_since_ns_ = 0;
  double s_ = -1.0;  // of the vehicle on the route; below 0: not known
  bool looked_ = false;
  int64_t looked_ns_ = 0;
  std::string problem_;
  PassingInput input_;  // obstacles in the map
};

}  // namespace pi_vehicle
