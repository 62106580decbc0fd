#pragma once

#include "policies/residence.h"

#include <cstddef>
#include <vector>

namespace pi_offload
{

/// Where the vehicle is on its planned route, and how long it stays in a node's range along it. The place on the route
/// only goes on, so that a route that crosses itself, or is a loop, is followed in its order, unless the vehicle is far
/// from where it can be by that. Not thread safe.
class RouteTracker
{
public:
  /// @throws std::invalid_argument naming the point that is not finite; the former route stays then.
  void setRoute(const std::vector<Point>& route);
  bool empty() const { return route_.empty(); }

  /// Follows the vehicle. @return true if it went so far that residences want to be computed anew.
  bool setPosition(const Point& position);
  /// Along the route from here on. `now_s` is exact up to HORIZON_S; beyond it is at least that.
  Residence residence(const Point& node, double range, double speed) const;
  /// The same to the end of the route.
  Residence wholeResidence(const Point& node, double range, double speed) const;

  /// Deadlines are far shorter; the cost of a residence grows with it.
  static constexpr double HORIZON_S = 10.0;

private:
  void findPlace();
  /// Looks for the nearest point of the route, over so much of its length at least.
  void searchFrom(size_t first, double window_m);
  const std::vector<Point>& ahead(double speed) const;

  std::vector<Point> route_;
  Point position_;
  Point computed_at_;  ///< position of the last place
  bool placed_ = false;
  size_t segment_ = 0;  ///< the vehicle is between this point and the next one
  Point on_route_;
  double off_route_m_ = 0.0;
  mutable std::vector<Point> ahead_;  ///< from the vehicle's place, as far as the horizon
  mutable double ahead_m_ = -1.0;     ///< length that was asked for; -1: none
  mutable bool cut_ = false;          ///< the route goes on behind it
};

}  // namespace pi_offload
