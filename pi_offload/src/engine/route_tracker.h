#pragma once

#include <cstddef>
#include <vector>

#include "policies/residence.h"

namespace pi_offload
{

/// Tracks the vehicle along its planned route and computes how long it stays in a node's range.
///
/// The place on the route only moves forward, so that loops and crossings are followed in their order. A vehicle far
/// from the place is looked for on the whole route. Not thread safe.
class RouteTracker
{
public:
  /// @throws std::invalid_argument naming the point that is not finite; the former route is kept.
  void setRoute(const std::vector<Point>& route);
  bool empty() const { return route_.empty(); }

  /// @return true if the vehicle moved far enough to compute residences again.
  bool setPosition(const Point& position);
  /// Residence along the route ahead. `now_s` is exact up to HORIZON_S; a larger value is a lower bound.
  Residence residence(const Point& node, double range, double speed) const;
  /// The same, exact to the end of the route.
  Residence wholeResidence(const Point& node, double range, double speed) const;

  /// Deadlines are far shorter. The computing time of a residence grows with this horizon.
  static constexpr double HORIZON_S = 10.0;

private:
  void findPlace();
  /// Looks for the nearest point on at least this length of the route.
  void searchFrom(size_t first, double window_m);
  const std::vector<Point>& ahead(double speed) const;

  std::vector<Point> route_;
  Point position_;
  Point computed_at_;  ///< position of the last place
  bool placed_ = false;
  size_t segment_ = 0;  ///< the vehicle is between this point and the next one
  Point on_route_;
  double off_route_m_ = 0.0;
  mutable std::vector<Point> ahead_;  ///< route from the vehicle to the horizon
  mutable double ahead_m_ = -1.0;     ///< length of `ahead_`; -1: not computed
  mutable bool cut_ = false;          ///< the route continues behind the horizon
};

}  // namespace pi_offload
