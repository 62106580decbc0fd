#include "engine/route_tracker.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_offload
{
namespace
{
/// Residences are computed again after this distance [m].
constexpr double RENEW_M = 0.3;
/// The next place is searched this far ahead, plus twice the distance since the last one [m].
constexpr double SEARCH_M = 20.0;
/// A vehicle further from its place is searched on the whole route [m].
constexpr double LOST_M = 10.0;
/// A vehicle within this distance counts as on the route, so that a nearer later part does not matter [m].
constexpr double NEAR_M = 3.0;
constexpr double LEAST_HORIZON_M = 10.0;

double distance(const Point& a, const Point& b)
{
  return std::sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y));
}
}  // namespace

void RouteTracker::setRoute(const std::vector<Point>& route)
{
  for (size_t i = 0; i < route.size(); ++i)
  {
    if (!std::isfinite(route[i].x) || !std::isfinite(route[i].y))
    {
      throw std::invalid_argument("route point " + std::to_string(i) + " = (" + std::to_string(route[i].x) + ", " +
                                  std::to_string(route[i].y) + "), must be finite");
    }
  }
  route_ = route;
  segment_ = 0;
  placed_ = false;
  ahead_m_ = -1.0;
}

bool RouteTracker::setPosition(const Point& position)
{
  position_ = position;
  if (route_.empty() || (placed_ && distance(position, computed_at_) < RENEW_M))
  {
    return false;
  }
  findPlace();
  return true;
}

void RouteTracker::findPlace()
{
  const double window_m = SEARCH_M + (placed_ ? 2.0 * distance(position_, computed_at_) : 0.0);
  computed_at_ = position_;
  placed_ = true;
  ahead_m_ = -1.0;
  if (route_.size() == 1)
  {
    on_route_ = route_.front();
    off_route_m_ = distance(position_, on_route_);
    return;
  }
  searchFrom(segment_, window_m);
  if (off_route_m_ > LOST_M && segment_ > 0)
  {
    searchFrom(0, std::numeric_limits<double>::infinity());
  }
}

void RouteTracker::searchFrom(size_t first, double window_m)
{
  double least = std::numeric_limits<double>::infinity();
  double looked_m = 0.0;
  for (size_t i = first; i + 1 < route_.size(); ++i)
  {
    if (looked_m > window_m && least <= LOST_M)
    {
      break;
    }
    const Point nearest = nearestOf(route_[i], route_[i + 1], position_);
    const double off = distance(position_, nearest);
    if (off < least)
    {
      least = off;
      segment_ = i;
      on_route_ = nearest;
    }
    looked_m += i == first ? distance(on_route_, route_[i + 1]) : distance(route_[i], route_[i + 1]);
  }
  off_route_m_ = least;
}

const std::vector<Point>& RouteTracker::ahead(double speed) const
{
  const double wanted_m = std::max(LEAST_HORIZON_M, HORIZON_S * speed);
  if (ahead_m_ == wanted_m)
  {
    return ahead_;
  }
  ahead_m_ = wanted_m;
  ahead_.assign(1, on_route_);
  double length = 0.0;
  size_t i = segment_ + 1;
  for (; i < route_.size() && length < wanted_m; ++i)
  {
    length += distance(ahead_.back(), route_[i]);
    ahead_.push_back(route_[i]);
  }
  cut_ = i < route_.size();
  return ahead_;
}

Residence RouteTracker::residence(const Point& node, double range, double speed) const
{
  const std::vector<Point>& path = ahead(speed);
  Residence residence = routeResidence(off_route_m_ <= NEAR_M ? on_route_ : position_, path, speed, node, range);
  if (cut_ && speed > 0.0)
  {
    // The vehicle does not stop at the horizon.
    const double horizon_s = ahead_m_ / speed;
    residence.now_s = std::min(residence.now_s, horizon_s);
    if (std::isinf(residence.leaves_s) && !std::isinf(residence.enters_s))
    {
      residence.leaves_s = std::max(horizon_s, residence.enters_s);
    }
  }
  return residence;
}

Residence RouteTracker::wholeResidence(const Point& node, double range, double speed) const
{
  std::vector<Point> path(1, on_route_);
  for (size_t i = segment_ + 1; i < route_.size(); ++i)
  {
    path.push_back(route_[i]);
  }
  return routeResidence(off_route_m_ <= NEAR_M ? on_route_ : position_, path, speed, node, range);
}

}  // namespace pi_offload
