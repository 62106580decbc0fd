#include "decision/route.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

namespace pi_vehicle
{
namespace
{

using Points = std::vector<Eigen::Vector2d>;

constexpr double SAME_POINT = 0.05;    // [m]
constexpr double SAME_HEADING = 0.02;  // [rad]
constexpr double RESERVE = 1.04;       // of radii: averaging tightens arcs a little
constexpr double JOIN_STEP = 0.25;     // between places to join that are tried [m]
constexpr size_t MAX_POINTS = 1000;
constexpr double MAX_COORDINATE = 1e5;  // [m]

std::string format(const char* form, double a, double b, double c)
{
  char text[240];
  std::snprintf(text, sizeof text, form, a, b, c);
  return text;
}

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

/// Averages over `window` of the way; open ends are thought to go on straight, so they stay where they are if they
/// begin with half a window of straight way.
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

}  // namespace

void RouteOptions::validate() const
{
  const pi_node::OptionCheck check("route");
  check.range("min_radius", min_radius, 0.1, 100.0);
  check.range("preferred_radius", preferred_radius, min_radius * RESERVE, 1000.0);
  check.range("corridor", corridor, 0.01, 100.0);
  check.range("spacing", spacing, 0.02, std::min(1.0, 0.2 * min_radius));
  check.range("transition", transition, 0.0, min_radius);
}

double dubins(const Pose2& from, const Pose2& to, double radius, double spacing, Points* points)
{
  // Shkel and Lumelsky 2001: in units of the radius, start at the origin, goal on the x axis.
  const Eigen::Vector2d way = to.position() - from.position();
  const double d = way.norm() / radius;
  const double direction = d > 1e-9 ? std::atan2(way.y(), way.x()) : 0.0;
  const double a = positiveAngle(from.heading - direction);
  const double b = positiveAngle(to.heading - direction);
  const double sa = std::sin(a);
  const double sb = std::sin(b);
  const double ca = std::cos(a);
  const double cb = std::cos(b);
  const double cab = std::cos(a - b);
  struct Word
  {
    std::array<int, 3> turn;  // 1: left, 0: straight, -1: right
    std::array<double, 3> length;
  };
  std::vector<Word> words;
  const auto add = [&words](std::array<int, 3> turn, double t, double p, double q) {
    words.push_back({turn, {positiveAngle(t), turn[1] == 0 ? p : positiveAngle(p), positiveAngle(q)}});
  };
  const double lsl = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb);
  if (lsl >= 0.0)
  {
    const double t = std::atan2(cb - ca, d + sa - sb);
    add({1, 0, 1}, t - a, std::sqrt(lsl), b - t);
  }
  const double rsr = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa);
  if (rsr >= 0.0)
  {
    const double t = std::atan2(ca - cb, d - sa + sb);
    add({-1, 0, -1}, a - t, std::sqrt(rsr), t - b);
  }
  const double lsr = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb);
  if (lsr >= 0.0)
  {
    const double p = std::sqrt(lsr);
    const double t = std::atan2(-ca - cb, d + sa + sb) - std::atan2(-2.0, p);
    add({1, 0, -1}, t - a, p, t - b);
  }
  const double rsl = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb);
  if (rsl >= 0.0)
  {
    const double p = std::sqrt(rsl);
    const double t = std::atan2(ca + cb, d - sa - sb) - std::atan2(2.0, p);
    add({-1, 0, 1}, a - t, p, b - t);
  }
  const double rlr = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0;
  if (std::abs(rlr) <= 1.0)
  {
    const double p = 2.0 * M_PI - std::acos(rlr);
    const double t = a - std::atan2(ca - cb, d - sa + sb) + 0.5 * p;
    add({-1, 1, -1}, t, p, a - b - t + p);
  }
  const double lrl = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0;
  if (std::abs(lrl) <= 1.0)
  {
    const double p = 2.0 * M_PI - std::acos(lrl);
    const double t = -a - std::atan2(ca - cb, d + sa - sb) + 0.5 * p;
    add({1, -1, 1}, t, p, b - a - t + p);
  }
  const Word* best = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const Word& word : words)
  {
    // Only what arrives counts: guards against rounding in the cases on the border.
    Pose2 end = from;
    for (size_t i = 0; i < 3; ++i)
    {
      end = end.moved(word.length[i] * radius, word.turn[i] / radius);
    }
    const double length = word.length[0] + word.length[1] + word.length[2];
    if (length < least && (end.position() - to.position()).norm() < 1e-3 * radius &&
        std::abs(wrapAngle(end.heading - to.heading)) < 1e-3)
    {
      least = length;
      best = &word;
    }
  }
  if (best == nullptr)
  {
    return std::numeric_limits<double>::infinity();
  }
  if (points != nullptr)
  {
    points->clear();
    points->push_back(from.position());
    Pose2 pose = from;
    for (size_t i = 0; i < 3; ++i)
    {
      const double length = best->length[i] * radius;
      const auto steps = static_cast<int>(std::ceil(length / spacing));
      for (int k = 1; k <= steps; ++k)
      {
        points->push_back(pose.moved(length * k / steps, best->turn[i] / radius).position());
      }
      pose = pose.moved(length, best->turn[i] / radius);
    }
  }
  return least * radius;
}

RouteResult planRoute(const RouteRequest& request, const RouteOptions& options)
{
  options.validate();
  RouteResult result;
  Points vertices;
  for (const Eigen::Vector2d& p : request.points)
  {
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > MAX_COORDINATE)
    {
      result.problem = "a point is not a number within 100 km of the map's origin: check the waypoints";
      return result;
    }
    if (vertices.empty() || (p - vertices.back()).norm() > SAME_POINT)
    {
      vertices.push_back(p);
    }
  }
  const bool loop = request.loop;
  if (loop && vertices.size() > 1 && (vertices.front() - vertices.back()).norm() <= SAME_POINT)
  {
    vertices.pop_back();
  }
  const size_t least = loop ? 3 : 2;
  if (vertices.size() < least || vertices.size() > MAX_POINTS)
  {
    result.problem = format("the route has %.0f different points, must have %.0f to %.0f",
                            static_cast<double>(vertices.size()), static_cast<double>(least), MAX_POINTS);
    return result;
  }
  if ((request.start_heading && !std::isfinite(*request.start_heading)) ||
      (request.goal_heading && !std::isfinite(*request.goal_heading)) ||
      (loop && (request.start_heading || request.goal_heading)))
  {
    result.problem = loop ? "a loop has no start or goal heading: leave them out" : "a heading is not a number";
    return result;
  }
  const size_t count = vertices.size();
  const size_t legs = loop ? count : count - 1;
  const auto vertex = [&vertices, count](size_t i) -> const Eigen::Vector2d& { return vertices[i % count]; };
  std::vector<double> length(legs);
  std::vector<double> heading(legs);
  for (size_t i = 0; i < legs; ++i)
  {
    const Eigen::Vector2d leg = vertex(i + 1) - vertex(i);
    length[i] = leg.norm();
    heading[i] = std::atan2(leg.y(), leg.x());
  }

  // Tangent lengths of corners; open ends have none.
  std::vector<double> turn(count, 0.0);
  std::vector<double> tangent(count, 0.0);
  for (size_t i = loop ? 0 : 1; i < (loop ? count : count - 1); ++i)
  {
    turn[i] = wrapAngle(heading[i % legs] - heading[(i + legs - 1) % legs]);
    const double half = 0.5 * std::abs(turn[i]);
    const double cut = 1.0 / std::cos(half) - 1.0;  // distance of the corner from the arc, by the radius
    const double radius = std::min(options.preferred_radius, options.corridor / std::max(cut, 1e-9));
    tangent[i] = radius * std::tan(half);
  }
  for (size_t i = 0; i < legs; ++i)
  {
    const double both = tangent[i] + tangent[(i + 1) % count];
    if (both > length[i])
    {
      tangent[i] *= length[i] / both;
      tangent[(i + 1) % count] *= length[i] / both;
    }
  }
  const double turning = options.min_radius * RESERVE;
  for (size_t i = 0; i < count; ++i)
  {
    const double half = 0.5 * std::abs(turn[i]);
    if (half > 1e-3 && tangent[i] < turning * std::tan(half) * (1.0 - 1e-9))
    {
      const double radius = tangent[i] / std::tan(half);
      result.problem = "waypoint " + std::to_string(i) +
                       format(
                           ": a turn of %.0f deg has room for a radius of %.2f m only, must be %.2f m: move waypoints "
                           "apart, add one, or widen the corridor",
                           std::abs(turn[i]) * 180.0 / M_PI, radius, turning);
      return result;
    }
  }

  // Turns begin and end with a straight piece: the steering takes its time.
  const double lead = 0.5 * options.transition + options.spacing;
  Points rough;
  const auto along = [&vertex, &heading](size_t leg, double s) -> Eigen::Vector2d
  { return vertex(leg) + s * Eigen::Vector2d(std::cos(heading[leg]), std::sin(heading[leg])); };
  double from = 0.0;                // of the first leg
  double until = length[legs - 1];  // of the last leg
  const bool turn_out =
      request.start_heading && std::abs(wrapAngle(*request.start_heading - heading[0])) > SAME_HEADING;
  const bool turn_in =
      request.goal_heading && std::abs(wrapAngle(*request.goal_heading - heading[legs - 1])) > SAME_HEADING;
  if (!loop && legs == 1 && (turn_out || turn_in))
  {
    const Pose2 start{vertices[0].x(), vertices[0].y(), request.start_heading.value_or(heading[0])};
    const Pose2 goal{vertices[1].x(), vertices[1].y(), request.goal_heading.value_or(heading[0])};
    Points turns;
    dubins(start.moved(lead, 0.0), goal.moved(-lead, 0.0), turning, options.spacing, &turns);
    append({start.position()}, &rough);
    append(turns, &rough);
    append({goal.position()}, &rough);
    return finish(rough, false, options);
  }
  Points head;
  Points tail;
  if (turn_out)
  {
    const Pose2 here{vertices[0].x(), vertices[0].y(), *request.start_heading};
    const Pose2 start = here.moved(lead, 0.0);
    double shortest = std::numeric_limits<double>::infinity();
    for (double s = 0.0; s <= length[0] - tangent[1]; s += JOIN_STEP)
    {
      const Eigen::Vector2d p = along(0, s);
      const double way = dubins(start, {p.x(), p.y(), heading[0]}, turning, options.spacing, nullptr) - s;
      if (way < shortest - 1e-6)
      {
        shortest = way;
        from = s;
      }
    }
    const Eigen::Vector2d p = along(0, from);
    dubins(start, {p.x(), p.y(), heading[0]}, turning, options.spacing, &head);
    append({here.position()}, &rough);
  }
  if (turn_in)
  {
    const Pose2 there{vertices.back().x(), vertices.back().y(), *request.goal_heading};
    const Pose2 goal = there.moved(-lead, 0.0);
    double shortest = std::numeric_limits<double>::infinity();
    for (double s = length[legs - 1]; s >= tangent[count - 2]; s -= JOIN_STEP)
    {
      const Eigen::Vector2d p = along(legs - 1, s);
      const double way = dubins({p.x(), p.y(), heading[legs - 1]}, goal, turning, options.spacing, nullptr) + s;
      if (way < shortest - 1e-6)
      {
        shortest = way;
        until = s;
      }
    }
    const Eigen::Vector2d p = along(legs - 1, until);
    dubins({p.x(), p.y(), heading[legs - 1]}, goal, turning, options.spacing, &tail);
    tail.push_back(there.position());
  }
  append(head, &rough);
  for (size_t i = 0; i < legs; ++i)
  {
    const size_t next = (i + 1) % count;
    const double begin = !loop && i == 0 ? from : tangent[i];
    const double end = !loop && i + 1 == legs ? until : length[i] - tangent[next];
    append({along(i, begin), along(i, std::max(begin, end))}, &rough);
    if (tangent[next] > 1e-6 && std::abs(turn[next]) > 1e-3)
    {
      const double radius = tangent[next] / std::tan(0.5 * std::abs(turn[next]));
      const double arc = radius * std::abs(turn[next]);
      const Eigen::Vector2d p = along(i, end);
      const Pose2 entry{p.x(), p.y(), heading[i]};
      const auto steps = std::max(2, static_cast<int>(std::ceil(arc / options.spacing)));
      Points curve;
      for (int k = 1; k <= steps; ++k)
      {
        curve.push_back(entry.moved(arc * k / steps, std::copysign(1.0 / radius, turn[next])).position());
      }
      append(curve, &rough);
    }
  }
  append(tail, &rough);
  if (loop && (rough.front() - rough.back()).norm() < 1e-3)
  {
    rough.pop_back();
  }
  result = finish(rough, loop, options);
  if (result.path)
  {
    for (const Eigen::Vector2d& p : vertices)
    {
      const PathProjection projection = result.path->project({p.x(), p.y(), 0.0});
      result.max_cut = std::max(result.max_cut, (result.path->at(projection.s).pose().position() - p).norm());
    }
  }
  return result;
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
