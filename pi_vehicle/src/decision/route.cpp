#include "decision/route.h"

#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace pi_vehicle
{

using pi_node::format;

namespace
{

using Points = std::vector<Eigen::Vector2d>;

constexpr double SAME_POINT = 0.05;    // [m]
constexpr double SAME_HEADING = 0.02;  // [rad]
constexpr double RESERVE = 1.04;       // factor on radii, as averaging tightens arcs a little
constexpr double JOIN_STEP = 0.25;     // between places to join that are tried [m]
constexpr size_t MAX_POINTS = 1000;
constexpr double MAX_COORDINATE = 1e5;  // [m]

double positiveAngle(double angle)
{
  const double a = std::fmod(angle, 2.0 * M_PI);
  const double positive = a < 0.0 ? a + 2.0 * M_PI : a;
  return positive > 2.0 * M_PI - 1e-9 ? 0.0 : positive;
}

void append(const Points& more, Points* points)
{
  for (const Eigen::Vector2d& p : more)
  {
    if (points->empty() || (points->back() - p).norm() > 1e-3)
    {
      points->push_back(p);
    }
  }
}

/// The polyline again, with equal steps of about `spacing`.
Points resampled(const Points& points, double spacing, bool closed)
{
  const Path path(points, closed);
  const auto count = static_cast<size_t>(std::max(3.0, std::round(path.length() / spacing)));
  Points even;
  for (size_t i = 0; i < count + (closed ? 0 : 1); ++i)
  {
    even.push_back(path.at(path.length() * static_cast<double>(i) / static_cast<double>(count)).pose().position());
  }
  return even;
}

/// Averages over `window` along the way. Open ends are prolonged straight, so an end that begins with half a window of
/// straight way stays in place.
Points averaged(const Points& points, double window, double spacing, bool closed)
{
  const auto count = static_cast<std::ptrdiff_t>(points.size());
  const auto half = std::min(static_cast<std::ptrdiff_t>(std::lround(0.5 * window / spacing)), (count - 1) / 2);
  const Eigen::Vector2d first = points[1] - points[0];
  const Eigen::Vector2d last = points[points.size() - 1] - points[points.size() - 2];
  Points smooth;
  for (std::ptrdiff_t i = 0; i < count; ++i)
  {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (std::ptrdiff_t j = i - half; j <= i + half; ++j)
    {
      if (!closed && j < 0)
      {
        sum += points.front() + static_cast<double>(j) * first;
      }
      else if (!closed && j >= count)
      {
        sum += points.back() + static_cast<double>(j - count + 1) * last;
      }
      else
      {
        sum += points[static_cast<size_t>((j + count) % count)];
      }
    }
    smooth.emplace_back(sum / static_cast<double>(2 * half + 1));
  }
  return smooth;
}

RouteResult finish(const Points& rough, bool closed, const RouteOptions& options)
{
  RouteResult result;
  const Points even = resampled(rough, options.spacing, closed);
  Path path(averaged(even, options.transition, options.spacing, closed), closed);
  for (const PathPoint& p : path.points())
  {
    result.max_curvature = std::max(result.max_curvature, std::abs(p.curvature));
  }
  if (result.max_curvature > 1.0 / options.min_radius)
  {
    result.problem =
        format("the path would bend by %.3f /m, must be at most %.3f /m (min_radius %.2f m): move points apart",
               result.max_curvature, 1.0 / options.min_radius, options.min_radius);
    return result;
  }
  result.path = std::move(path);
  return result;
}

struct DubinsWord
{
  std::array<int, 3> turn;       // 1: left, 0: straight, -1: right
  std::array<double, 3> length;  // in radii

  double total() const { return length[0] + length[1] + length[2]; }
};

/// All words from heading `a` at the origin to heading `b` at (d, 0), in units of the radius (Shkel and Lumelsky 2001).
std::vector<DubinsWord> dubinsWords(double d, double a, double b)
{
  const double sa = std::sin(a);
  const double sb = std::sin(b);
  const double ca = std::cos(a);
  const double cb = std::cos(b);
  const double cab = std::cos(a - b);
  std::vector<DubinsWord> words;
  const auto add = [&words](std::array<int, 3> turn, double t, double p, double q) {
    words.push_back({turn, {positiveAngle(t), turn[1] == 0 ? p : positiveAngle(p), positiveAngle(q)}});
  };
  if (const double lsl = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb); lsl >= 0.0)
  {
    const double t = std::atan2(cb - ca, d + sa - sb);
    add({1, 0, 1}, t - a, std::sqrt(lsl), b - t);
  }
  if (const double rsr = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa); rsr >= 0.0)
  {
    const double t = std::atan2(ca - cb, d - sa + sb);
    add({-1, 0, -1}, a - t, std::sqrt(rsr), t - b);
  }
  if (const double lsr = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb); lsr >= 0.0)
  {
    const double p = std::sqrt(lsr);
    const double t = std::atan2(-ca - cb, d + sa + sb) - std::atan2(-2.0, p);
    add({1, 0, -1}, t - a, p, t - b);
  }
  if (const double rsl = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb); rsl >= 0.0)
  {
    const double p = std::sqrt(rsl);
    const double t = std::atan2(ca + cb, d - sa - sb) - std::atan2(2.0, p);
    add({-1, 0, 1}, a - t, p, b - t);
  }
  if (const double rlr = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0; std::abs(rlr) <= 1.0)
  {
    const double p = 2.0 * M_PI - std::acos(rlr);
    const double t = a - std::atan2(ca - cb, d - sa + sb) + 0.5 * p;
    add({-1, 1, -1}, t, p, a - b - t + p);
  }
  if (const double lrl = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0; std::abs(lrl) <= 1.0)
  {
    const double p = 2.0 * M_PI - std::acos(lrl);
    const double t = -a - std::atan2(ca - cb, d + sa - sb) + 0.5 * p;
    add({1, -1, 1}, t, p, b - a - t + p);
  }
  return words;
}

/// Guards against rounding of words on the border of their range.
bool arrives(const DubinsWord& word, const Pose2& from, const Pose2& to, double radius)
{
  Pose2 end = from;
  for (size_t i = 0; i < 3; ++i)
  {
    end = end.moved(word.length[i] * radius, word.turn[i] / radius);
  }
  return (end.position() - to.position()).norm() < 1e-3 * radius &&
         std::abs(wrapAngle(end.heading - to.heading)) < 1e-3;
}

Points sampled(const DubinsWord& word, const Pose2& from, double radius, double spacing)
{
  Points points{from.position()};
  Pose2 pose = from;
  for (size_t i = 0; i < 3; ++i)
  {
    const double length = word.length[i] * radius;
    const auto steps = static_cast<int>(std::ceil(length / spacing));
    for (int k = 1; k <= steps; ++k)
    {
      points.push_back(pose.moved(length * k / steps, word.turn[i] / radius).position());
    }
    pose = pose.moved(length, word.turn[i] / radius);
  }
  return points;
}

/// The waypoints without repetitions. @return the problem; empty: none.
std::string distinctVertices(const RouteRequest& request, Points* vertices)
{
  for (const Eigen::Vector2d& p : request.points)
  {
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > MAX_COORDINATE)
    {
      return "a point is not a number within 100 km of the map's origin: check the waypoints";
    }
    if (vertices->empty() || (p - vertices->back()).norm() > SAME_POINT)
    {
      vertices->push_back(p);
    }
  }
  if (request.loop && vertices->size() > 1 && (vertices->front() - vertices->back()).norm() <= SAME_POINT)
  {
    vertices->pop_back();
  }
  const size_t least = request.loop ? 3 : 2;
  if (vertices->size() < least || vertices->size() > MAX_POINTS)
  {
    return format("the route has %.0f different points, must have %.0f to %.0f", static_cast<double>(vertices->size()),
                  static_cast<double>(least), static_cast<double>(MAX_POINTS));
  }
  const bool headings_given = request.start_heading || request.goal_heading;
  if (request.loop && headings_given)
  {
    return "a loop has no start or goal heading: leave them out";
  }
  const bool finite =
      std::isfinite(request.start_heading.value_or(0.0)) && std::isfinite(request.goal_heading.value_or(0.0));
  return finite ? "" : "a heading is not a number";
}

/// The straight legs between waypoints and the arcs that round their corners.
class Legs
{
public:
  Legs(const Points& vertices, bool loop, const RouteOptions& options)
    : vertices_(vertices)
    , loop_(loop)
    , options_(options)
    , count_(loop ? vertices.size() : vertices.size() - 1)
    , turn_(vertices.size(), 0.0)
    , tangent_(vertices.size(), 0.0)
  {
    for (size_t i = 0; i < count_; ++i)
    {
      const Eigen::Vector2d leg = vertex(i + 1) - vertex(i);
      length_.push_back(leg.norm());
      heading_.push_back(std::atan2(leg.y(), leg.x()));
    }
    chooseTangentLengths();
    shareLegs();
  }

  size_t count() const { return count_; }
  double length(size_t leg) const { return length_[leg]; }
  double heading(size_t leg) const { return heading_[leg]; }
  double tangent(size_t corner) const { return tangent_[corner]; }  ///< from the corner to the ends of its arc [m]
  Pose2 at(size_t leg, double s) const
  {
    const Eigen::Vector2d p = vertex(leg) + s * Eigen::Vector2d(std::cos(heading_[leg]), std::sin(heading_[leg]));
    return {p.x(), p.y(), heading_[leg]};
  }

  /// The first corner with room for less than `least_radius`; empty: none.
  std::string tightCorner(double least_radius) const
  {
    for (size_t i = 0; i < vertices_.size(); ++i)
    {
      const double half = 0.5 * std::abs(turn_[i]);
      if (half > 1e-3 && tangent_[i] < least_radius * std::tan(half) * (1.0 - 1e-9))
      {
        return "waypoint " + std::to_string(i) +
               format(
                   ": a turn of %.0f deg has room for a radius of %.2f m only, must be %.2f m: move waypoints "
                   "apart, add one, or widen the corridor",
                   std::abs(turn_[i]) * 180.0 / M_PI, tangent_[i] / std::tan(half), least_radius);
      }
    }
    return "";
  }

  /// Straights and arcs, from `from` on the first leg to `until` on the last (a loop: all of it).
  void draw(double from, double until, Points* points) const
  {
    for (size_t i = 0; i < count_; ++i)
    {
      const size_t next = (i + 1) % vertices_.size();
      const double begin = !loop_ && i == 0 ? from : tangent_[i];
      const double end = !loop_ && i + 1 == count_ ? until : length_[i] - tangent_[next];
      append({at(i, begin).position(), at(i, std::max(begin, end)).position()}, points);
      if (tangent_[next] > 1e-6 && std::abs(turn_[next]) > 1e-3)
      {
        append(arc(at(i, end), next), points);
      }
    }
  }

private:
  const Eigen::Vector2d& vertex(size_t i) const { return vertices_[i % vertices_.size()]; }

  void chooseTangentLengths()
  {
    for (size_t i = loop_ ? 0 : 1; i < count_; ++i)  // open ends have no corner
    {
      turn_[i] = wrapAngle(heading_[i % count_] - heading_[(i + count_ - 1) % count_]);
      const double half = 0.5 * std::abs(turn_[i]);
      const double cut = 1.0 / std::cos(half) - 1.0;  // distance of the corner from the arc, by the radius
      const double radius = std::min(options_.preferred_radius, options_.corridor / std::max(cut, 1e-9));
      tangent_[i] = radius * std::tan(half);
    }
  }

  /// Shortens the arcs at both ends of a leg that is too short for them.
  void shareLegs()
  {
    for (size_t i = 0; i < count_; ++i)
    {
      double& next = tangent_[(i + 1) % vertices_.size()];
      const double both = tangent_[i] + next;
      if (both > length_[i])
      {
        tangent_[i] *= length_[i] / both;
        next *= length_[i] / both;
      }
    }
  }

  Points arc(const Pose2& entry, size_t corner) const
  {
    const double radius = tangent_[corner] / std::tan(0.5 * std::abs(turn_[corner]));
    const double length = radius * std::abs(turn_[corner]);
    const auto steps = std::max(2, static_cast<int>(std::ceil(length / options_.spacing)));
    Points curve;
    for (int k = 1; k <= steps; ++k)
    {
      curve.push_back(entry.moved(length * k / steps, std::copysign(1.0 / radius, turn_[corner])).position());
    }
    return curve;
  }

  const Points& vertices_;
  const bool loop_;
  const RouteOptions& options_;
  const size_t count_;
  std::vector<double> length_;   // of each leg [m]
  std::vector<double> heading_;  // of each leg [rad]
  std::vector<double> turn_;     // at each vertex, left positive [rad]
  std::vector<double> tangent_;  // at each vertex [m]
};

/// Joins the legs with the headings asked for at the start and the goal by Dubins paths.
class EndTurns
{
public:
  EndTurns(const RouteRequest& request, const Points& vertices, const Legs& legs, const RouteOptions& options)
    : legs_(legs)
    , options_(options)
    , turning_(options.min_radius * RESERVE)
    , lead_(0.5 * options.transition + options.spacing)
    , last_(legs.count() - 1)
    , start_{vertices.front().x(), vertices.front().y(), request.start_heading.value_or(legs.heading(0))}
    , goal_{vertices.back().x(), vertices.back().y(), request.goal_heading.value_or(legs.heading(last_))}
    , at_start_(differs(start_.heading, legs.heading(0)))
    , at_goal_(differs(goal_.heading, legs.heading(last_)))
  {
  }

  bool any() const { return at_start_ || at_goal_; }

  /// Of a route with one leg.
  Points direct() const
  {
    Points points;
    append({start_.position()}, &points);
    append(turn(start_.moved(lead_, 0.0), goal_.moved(-lead_, 0.0)), &points);
    append({goal_.position()}, &points);
    return points;
  }

  /// @param[out] from  where the turn joins the first leg [m]; stays without a turn.
  Points out(double* from) const
  {
    if (!at_start_)
    {
      return {};
    }
    const Pose2 start = start_.moved(lead_, 0.0);
    double shortest = std::numeric_limits<double>::infinity();
    for (double s = 0.0; s <= legs_.length(0) - legs_.tangent(1); s += JOIN_STEP)
    {
      const double way = dubins(start, legs_.at(0, s), turning_, options_.spacing, nullptr) - s;
      if (way < shortest - 1e-6)
      {
        shortest = way;
        *from = s;
      }
    }
    Points points{start_.position()};
    append(turn(start, legs_.at(0, *from)), &points);
    return points;
  }

  /// @param[out] until  where the turn leaves the last leg [m]; stays without a turn.
  Points in(double* until) const
  {
    if (!at_goal_)
    {
      return {};
    }
    const Pose2 goal = goal_.moved(-lead_, 0.0);
    double shortest = std::numeric_limits<double>::infinity();
    for (double s = legs_.length(last_); s >= legs_.tangent(last_); s -= JOIN_STEP)
    {
      const double way = dubins(legs_.at(last_, s), goal, turning_, options_.spacing, nullptr) + s;
      if (way < shortest - 1e-6)
      {
        shortest = way;
        *until = s;
      }
    }
    Points points = turn(legs_.at(last_, *until), goal);
    points.push_back(goal_.position());
    return points;
  }

private:
  static bool differs(double heading, double leg) { return std::abs(wrapAngle(heading - leg)) > SAME_HEADING; }

  Points turn(const Pose2& from, const Pose2& to) const
  {
    Points points;
    dubins(from, to, turning_, options_.spacing, &points);
    return points;
  }

  const Legs& legs_;
  const RouteOptions& options_;
  const double turning_;  // radius [m]
  const double lead_;     // turns begin and end with a straight piece, as the steering takes time [m]
  const size_t last_;     // leg
  const Pose2 start_;
  const Pose2 goal_;
  const bool at_start_;
  const bool at_goal_;
};

}  // namespace

void RouteOptions::validate() const
{
  const pi_node::OptionCheck check("route");
  check.range("min_radius", min_radius, 0.1, 100.0);
  check.range("preferred_radius", preferred_radius, min_radius * RESERVE, 1000.0);
  check.range("corridor", corridor, 0.01, 100.0);
  check.range("spacing", spacing, 0.02, std::min(1.0, 0.2 * min_radius));
  check.range("transition", transition, 0.0, min_radius, "1 / vehicle/limits/curvature");
}

double dubins(const Pose2& from, const Pose2& to, double radius, double spacing, Points* points)
{
  const Eigen::Vector2d way = to.position() - from.position();
  const double d = way.norm() / radius;
  const double direction = d > 1e-9 ? std::atan2(way.y(), way.x()) : 0.0;
  const std::vector<DubinsWord> words =
      dubinsWords(d, positiveAngle(from.heading - direction), positiveAngle(to.heading - direction));
  const DubinsWord* best = nullptr;
  for (const DubinsWord& word : words)
  {
    if ((best == nullptr || word.total() < best->total()) && arrives(word, from, to, radius))
    {
      best = &word;
    }
  }
  if (best == nullptr)
  {
    return std::numeric_limits<double>::infinity();
  }
  if (points != nullptr)
  {
    *points = sampled(*best, from, radius, spacing);
  }
  return best->total() * radius;
}

RouteResult planRoute(const RouteRequest& request, const RouteOptions& options)
{
  options.validate();
  RouteResult result;
  Points vertices;
  result.problem = distinctVertices(request, &vertices);
  if (!result.problem.empty())
  {
    return result;
  }
  const Legs legs(vertices, request.loop, options);
  result.problem = legs.tightCorner(options.min_radius * RESERVE);
  if (!result.problem.empty())
  {
    return result;
  }
  const EndTurns turns(request, vertices, legs, options);
  if (!request.loop && legs.count() == 1 && turns.any())
  {
    return finish(turns.direct(), false, options);
  }
  double from = 0.0;
  double until = legs.length(legs.count() - 1);
  Points rough = turns.out(&from);
  const Points tail = turns.in(&until);
  legs.draw(from, until, &rough);
  append(tail, &rough);
  if (request.loop && (rough.front() - rough.back()).norm() < 1e-3)
  {
    rough.pop_back();
  }
  return finish(rough, request.loop, options);
}

RouteResult rejoinRoute(const Path& path, const Pose2& pose, double ahead, const RouteOptions& options)
{
  options.validate();
  RouteResult result;
  if (path.empty() || !pose.finite() || !(ahead > 0.0))
  {
    result.problem = "there is no path, or a number is none";
    return result;
  }
  const double turning = options.min_radius * RESERVE;
  const Pose2 start = pose.moved(0.5 * options.transition + options.spacing, 0.0);
  const double nearest = path.project(start, 1.0).s;
  const double end =
      path.closed() ? nearest + std::min(ahead, path.length()) : std::min(nearest + ahead, path.length());
  double best = -1.0;
  double shortest = std::numeric_limits<double>::infinity();
  for (double s = nearest; s <= end; s += JOIN_STEP)
  {
    const double way = dubins(start, path.at(s).pose(), turning, options.spacing, nullptr) - (s - nearest);
    if (way < shortest - 1e-6)
    {
      shortest = way;
      best = s;
    }
  }
  Points rough;
  Points lead;
  dubins(start, path.at(best).pose(), turning, options.spacing, &lead);
  append({pose.position()}, &rough);
  append(lead, &rough);
  Points rest;
  const double last = path.closed() ? nearest + path.length() : path.length();
  for (double s = best + options.spacing; s < last; s += options.spacing)
  {
    rest.push_back(path.at(s).pose().position());
  }
  if (!path.closed())
  {
    rest.push_back(path.points().back().pose().position());
  }
  append(rest, &rough);
  if (rough.size() < 2)
  {
    result.problem = "the end of the path is reached: nothing to rejoin";
    return result;
  }
  return finish(rough, false, options);
}

}  // namespace pi_vehicle
