#include "policies/residence.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>

namespace pi_offload
{

namespace
{

constexpr double NEVER = std::numeric_limits<double>::infinity();

void requireFinite(const char* name, const Point& point)
{
  if (!std::isfinite(point.x) || !std::isfinite(point.y))
  {
    std::ostringstream text;
    text << name << " = (" << point.x << ", " << point.y << "), must be finite";
    throw std::invalid_argument(text.str());
  }
}

void requireInputs(const Point& vehicle, double speed, const Point& node, double range)
{
  requireFinite("vehicle", vehicle);
  requireFinite("node", node);
  if (!(speed >= 0.0 && std::isfinite(speed)))
  {
    throw std::invalid_argument("speed = " + std::to_string(speed) + ", must be finite and at least 0");
  }
  if (!(range >= 0.0))
  {
    throw std::invalid_argument("range = " + std::to_string(range) + ", must be at least 0");
  }
}

Residence always()
{
  return {NEVER, 0.0, NEVER};
}

Residence never()
{
  return {0.0, NEVER, 0.0};
}

/// Part of a straight line within a range of the origin, as distances along the line.
struct Chord
{
  double from = 0.0;
  double to = 0.0;
};

/// @param d  start of the line, from the node.
/// @param u  its direction, of length 1.
/// Without cancellation: q = b^2 - c = R^2 - (d x u)^2 comes from the cross product, and -c is (R - |d|)(R + |d|).
/// A tangent is no chord.
std::optional<Chord> chordOf(const Point& d, const Point& u, double range)
{
  const double across = std::abs(d.x * u.y - d.y * u.x);
  const double q = (range - across) * (range + across);
  if (!(q > 0.0))
  {
    return std::nullopt;
  }
  const double b = d.x * u.x + d.y * u.y;
  const double root = std::sqrt(q);
  const double distance = std::hypot(d.x, d.y);
  const double minus_c = (range - distance) * (range + distance);
  Chord chord;
  chord.from = b < 0.0 ? -minus_c / (root - b) : -b - root;
  chord.to = b > 0.0 ? minus_c / (b + root) : root - b;
  return chord;
}

Point directionOf(double heading)
{
  return {std::sin(heading), std::cos(heading)};
}

/// Follows a path piece by piece until the first window is complete.
class WindowSearch
{
public:
  WindowSearch(const Point& node, double range) : node_(node), range_(range) {}

  /// @return true once the window is complete.
  bool addPiece(const Point& from, const Point& to)
  {
    const double length = std::hypot(to.x - from.x, to.y - from.y);
    if (!(length > 0.0))
    {
      return false;
    }
    const Point u{(to.x - from.x) / length, (to.y - from.y) / length};
    const std::optional<Chord> chord = chordOf({from.x - node_.x, from.y - node_.y}, u, range_);
    const double begin = chord ? std::max(chord->from, 0.0) : 0.0;
    const double end = chord ? std::min(chord->to, length) : -1.0;
    const bool touches = end >= begin;
    if (open_ && (!touches || begin > tolerance_) && close(travelled_))
    {
      return true;
    }
    if (touches)
    {
      if (!open_)
      {
        open_ = true;
        entered_ = travelled_ + begin;
      }
      if (end < length - tolerance_ && close(travelled_ + end))
      {
        return true;
      }
    }
    travelled_ += length;
    return false;
  }

  bool startsInside(const Point& vehicle)
  {
    starts_inside_ = std::hypot(vehicle.x - node_.x, vehicle.y - node_.y) <= range_;
    open_ = starts_inside_;
    return open_;
  }

  /// @param end  end of the path.
  Residence result(const Point& end, double speed) const
  {
    if (complete_)
    {
      return {starts_inside_ ? left_ / speed : 0.0, entered_ / speed, left_ / speed};
    }
    if (open_ || std::hypot(end.x - node_.x, end.y - node_.y) <= range_)
    {
      const double entered = open_ ? entered_ : travelled_;
      return {starts_inside_ ? NEVER : 0.0, entered / speed, NEVER};
    }
    return never();
  }

private:
  /// A window without length does not count, unless the vehicle leaves right now.
  bool close(double at)
  {
    open_ = false;
    left_ = at;
    complete_ = starts_inside_ || left_ - entered_ > tolerance_;
    return complete_;
  }

  Point node_;
  double range_;
  double tolerance_ = 1e-9;  ///< rounding at corners on the edge must not split a window [m]
  bool starts_inside_ = false;
  bool open_ = false;
  bool complete_ = false;
  double travelled_ = 0.0;
  double entered_ = 0.0;
  double left_ = 0.0;
};

}  // namespace

Point nearestOf(const Point& from, const Point& to, const Point& p)
{
  const Point u{to.x - from.x, to.y - from.y};
  const double square = u.x * u.x + u.y * u.y;
  const double share =
      square > 0.0 ? std::clamp(((p.x - from.x) * u.x + (p.y - from.y) * u.y) / square, 0.0, 1.0) : 0.0;
  return {from.x + share * u.x, from.y + share * u.y};
}

Residence straightResidence(const Point& vehicle, double heading, double speed, const Point& node, double range)
{
  requireInputs(vehicle, speed, node, range);
  if (!std::isfinite(heading))
  {
    throw std::invalid_argument("heading = " + std::to_string(heading) + ", must be finite");
  }
  const Point d{vehicle.x - node.x, vehicle.y - node.y};
  const bool inside = std::hypot(d.x, d.y) <= range;
  if (std::isinf(range) || (inside && speed == 0.0))
  {
    return always();
  }
  const std::optional<Chord> chord = speed > 0.0 ? chordOf(d, directionOf(heading), range) : std::nullopt;
  if (inside)
  {
    const double leaves = chord ? std::max(chord->to, 0.0) / speed : 0.0;
    return {leaves, 0.0, leaves};
  }
  if (!chord || chord->to <= 0.0)
  {
    return never();
  }
  return {0.0, chord->from / speed, chord->to / speed};
}

double headingOfYaw(double yaw)
{
  return M_PI_2 - yaw;
}

double printedResidence(const Point& vehicle, double heading, double speed, const Point& node, double range)
{
  requireInputs(vehicle, speed, node, range);
  if (!std::isfinite(heading))
  {
    throw std::invalid_argument("heading = " + std::to_string(heading) + ", must be finite");
  }
  if (speed == 0.0)
  {
    return 0.0;
  }
  if (std::isinf(range))
  {
    return NEVER;
  }
  const std::optional<Chord> chord = chordOf({vehicle.x - node.x, vehicle.y - node.y}, directionOf(heading), range);
  return chord ? std::max(chord->to, 0.0) / speed : 0.0;
}

Residence routeResidence(const Point& vehicle, const std::vector<Point>& route, double speed, const Point& node,
                         double range)
{
  requireInputs(vehicle, speed, node, range);
  if (route.empty())
  {
    throw std::invalid_argument("route has no points, must have at least one");
  }
  for (const Point& point : route)
  {
    requireFinite("a point of the route", point);
  }
  WindowSearch search(node, range);
  const bool inside = search.startsInside(vehicle);
  if (std::isinf(range) || (inside && speed == 0.0))
  {
    return always();
  }
  if (speed == 0.0)
  {
    return never();
  }
  size_t segment = 0;
  Point at = route.front();
  double least = NEVER;
  for (size_t i = 0; i + 1 < route.size(); ++i)
  {
    const Point point = nearestOf(route[i], route[i + 1], vehicle);
    const double distance = std::hypot(vehicle.x - point.x, vehicle.y - point.y);
    if (distance < least)
    {
      least = distance;
      segment = i;
      at = point;
    }
  }
  bool complete = search.addPiece(vehicle, at);
  for (size_t i = segment + 1; i < route.size() && !complete; ++i)
  {
    complete = search.addPiece(at, route[i]);
    at = route[i];
  }
  return search.result(at, speed);
}

}  // namespace pi_offload
