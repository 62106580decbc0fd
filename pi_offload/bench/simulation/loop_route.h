#pragma once

#include <vector>

#include "policies/residence.h"

namespace pi_offload::simulation
{

/// A closed polyline as a route.
class LoopRoute
{
public:
  /// @param points  at least two different ones; the last is joined to the first
  explicit LoopRoute(std::vector<Point> points);

  double length() const { return starts_.back(); }  ///< [m]
  /// @param way  [m] along the loop, any number from 0
  Point at(double way) const;
  /// From +Y, clockwise [rad], in (-pi, pi].
  double heading(double way) const;
  /// One round from here.
  std::vector<Point> ahead(double way) const;

private:
  size_t segment(double* way) const;

  std::vector<Point> points_;   ///< the first one again at the end
  std::vector<double> starts_;  ///< of each point, along the loop
};

}  // namespace pi_offload::simulation
