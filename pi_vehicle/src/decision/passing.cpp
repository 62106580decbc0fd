#include "decision/passing.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace pi_vehicle
{

using pi_node::format;
using pi_node::seconds;

namespace
{

constexpr double APPROACH = 4.5;          // before hold_distance: from here on the way round is looked for [m]
constexpr double MOST_BESIDE = 25.0;      // longest way at the full shift [m]
constexpr double PLACE_STEP = 0.25;       // between places that are looked at [m]
constexpr double SHIFT_STEP = 0.2;        // between shifts that are tried [m]
constexpr double CELL_STEP = 0.1;         // across the way [m]
constexpr double LEAST_SHIFTING = 3.0;    // length of a shift [m]
constexpr double LEAD_S = 0.4;            // of the way until a new path acts [s]
constexpr double LOOK_PERIOD_S = 0.3;     // between two searches
constexpr double BLOCKING_MARGIN = 0.3;   // nearer to the way, an obstacle blocks it [m]
constexpr double SEEN_MARGIN = 0.2;       // of ground that must be free beside the outline [m]
constexpr double PEOPLE_CLEARANCE = 1.0;  // to those who stand beside the way round [m]
constexpr int MOST_OCCUPIED = 2;          // places of the ground on the way round: single ones are noise
constexpr double COMING_STEP_S = 0.5;     // of predictions
constexpr double BEND = 1.4;              // the way round bends at most by so many times max_curvature, with the route
constexpr double QUINTIC_CURVATURE = 5.774;  // largest second derivative of the unit quintic step
constexpr double PERSON_LIKE_S = 10.0;       // what looks like a person is one until it has stood for so long
constexpr double PERSON_HEIGHT = 0.9;        // at least [m]
constexpr double PERSON_WIDTH = 1.1;         // at most [m]
constexpr double NEAR_PATH = 3.0;  // of the place on the route before, in which the next one is looked for [m]

bool isAlive(const std::string& label)
{
  static const std::array<const char*, 8> ALIVE = {"person", "cat", "dog", "horse", "sheep", "cow", "bird", "bicycle"};
  return std::find(ALIVE.begin(), ALIVE.end(), label) != ALIVE.end();
}

/// A person whom the detector did not see, by width and height: those who cross also stop on the way.
bool mayBePerson(const KnownObstacle& obstacle, const Eigen::Vector2d& eye)
{
  return isAlive(obstacle.label) || (obstacle.standing_s < PERSON_LIKE_S && obstacle.top >= PERSON_HEIGHT &&
                                     obstacle.outline.widthFrom(eye) < PERSON_WIDTH);
}

/// x^5-polynomial on [0, length] from (value, slope, 0) to (target, 0, 0).
double quintic(double at, double length, double value, double slope, double target)
{
  const double t = at / length;
  const double step = target - value;
  const double m = slope * length;
  const double c3 = 10.0 * step - 6.0 * m;
  const double c4 = -15.0 * step + 8.0 * m;
  const double c5 = 6.0 * step - 3.0 * m;
  return value + t * (m + t * t * (c3 + t * (c4 + t * c5)));
}

double shiftingLength(double by, double max_curvature)
{
  return std::max(LEAST_SHIFTING, std::sqrt(QUINTIC_CURVATURE * std::abs(by) / max_curvature));
}

}  // namespace

void PassingOptions::validate() const
{
  const pi_node::OptionCheck check("passing");
  check.range("left", left, 0.0, 50.0);
  check.range("right", right, 0.0, 50.0);
  check.range("hold_distance", hold_distance, 0.0, 50.0);
  check.range("speed", speed, 0.1, 10.0);
  check.range("clearance", clearance, BLOCKING_MARGIN, 5.0);
  check.range("known_for", known_for, 0.0, 60.0);
  check.range("max_curvature", max_curvature, 0.01, 5.0);
  check.range("seen", seen, 0.0, 1.0);
}

Passing::Passing(const PassingOptions& options, const pi_node::Footprint& vehicle, const pi_node::MotionLimits& limits)
  : options_((options.validate(), options)), vehicle_(vehicle), limits_(limits)
{
}

void Passing::setRoute(const Path& route)
{
  route_ = route;
  path_ = route;
  detour_.reset();
  s_ = -1.0;
  looked_ = false;
  problem_.clear();
}

double Passing::Detour::at(double length) const
{
  if (length <= 0.0)
  {
    return from + slope * length;
  }
  if (length < shifted)
  {
    return quintic(length, shifted, from, slope, shift);
  }
  if (length <= back)
  {
    return shift;
  }
  return length < end ? quintic(length - back, end - back, shift, 0.0, 0.0) : 0.0;
}

double Passing::Detour::slopeAt(double length) const
{
  return (at(length + 0.05) - at(length - 0.05)) / 0.1;
}

double Passing::lengthOn(const Detour& detour, double s) const
{
  const double length = s - detour.begin;
  return route_.closed() ? std::remainder(length, route_.length()) : length;
}

bool Passing::bendsTooMuch(const Detour& detour) const
{
  for (double length = PLACE_STEP; length < detour.end; length += PLACE_STEP)
  {
    const Pose2 before = placeOn(detour, length - PLACE_STEP);
    const Pose2 after = placeOn(detour, length + PLACE_STEP);
    const double distance = (after.position() - before.position()).norm();
    if (std::abs(wrapAngle(after.heading - before.heading)) > BEND * options_.max_curvature * distance)
    {
      return true;
    }
  }
  return false;
}

Pose2 Passing::placeOn(const Detour& detour, double length) const
{
  const PathPoint point = route_.at(detour.begin + length);
  const double shift = detour.at(length);
  const double slope = detour.slopeAt(length);
  const Eigen::Vector2d p = point.pose() * Eigen::Vector2d(0.0, shift);
  return {p.x(), p.y(), point.heading + std::atan2(slope, std::max(0.1, 1.0 - point.curvature * shift))};
}

bool Passing::touches(const KnownObstacle& obstacle, const Pose2& place, double clearance) const
{
  const Eigen::Vector2d along(std::cos(place.heading), std::sin(place.heading));
  const GroundRectangle rectangle{
      place.position() + 0.5 * (vehicle_.front - vehicle_.rear) * along,
      along,
      {0.5 * (vehicle_.front + vehicle_.rear) + std::min(clearance, BLOCKING_MARGIN), vehicle_.half_width + clearance}};
  return obstacle.outline.overlaps(rectangle, Eigen::Vector2d::Zero());
}

/// Near the place before, unless the pose has jumped.
PathProjection Passing::locate() const
{
  if (s_ >= 0.0)
  {
    const PathProjection near = route_.project(input_.pose, s_ - NEAR_PATH, s_ + NEAR_PATH);
    const double distance = (route_.at(near.s).pose().position() - input_.pose.position()).norm();
    if (distance <= std::max(options_.left, options_.right) + NEAR_PATH)
    {
      return near;
    }
  }
  return route_.project(input_.pose, 1.0);
}

Passing::Blocker Passing::firstBlocker() const
{
  const double begin = path_.project(input_.pose, 1.0).s;
  const double look_ahead = options_.hold_distance + APPROACH;
  const double most = path_.closed() ? look_ahead : std::min(look_ahead, path_.length() - begin);
  for (double distance = 0.0; distance <= most; distance += PLACE_STEP)
  {
    const Pose2 place = placeOn(path_, begin + distance);
    for (const KnownObstacle& obstacle : input_.obstacles)
    {
      // What stands beside the vehicle already, nearer than the margin, does not block it.
      if (!obstacle.moving && touches(obstacle, place, BLOCKING_MARGIN) &&
          (distance > 0.0 || touches(obstacle, placeOn(path_, begin + 1.0), 0.0)))
      {
        return {&obstacle, distance};
      }
    }
  }
  return {};
}

bool Passing::isClear(const Detour& detour, double from, double to, double clearance) const
{
  for (double length = from; length <= to; length += PLACE_STEP)
  {
    const Pose2 place = placeOn(detour, length);
    for (const KnownObstacle& obstacle : input_.obstacles)
    {
      if (!obstacle.moving &&
          touches(obstacle, place,
                  mayBePerson(obstacle, input_.pose.position()) ? std::max(PEOPLE_CLEARANCE, clearance) : clearance))
      {
        return false;
      }
    }
  }
  return true;
}

/// What is wrong with a way round that no standing obstacle touches: somebody comes, or the ground is not free.
std::string Passing::problemOf(const Detour& detour) const
{
  const std::string side = detour.shift > 0.0 ? "the way round on the left " : "the way round on the right ";
  for (const KnownObstacle& obstacle : input_.obstacles)
  {
    for (double t = 0.0; obstacle.moving && t <= detour.end / options_.speed; t += COMING_STEP_S)
    {
      KnownObstacle later = obstacle;
      later.outline = obstacle.outline.in(Pose2(), t * obstacle.velocity);
      for (double length = 0.0; length <= detour.end; length += 4.0 * PLACE_STEP)
      {
        if (touches(later, placeOn(detour, length), BLOCKING_MARGIN))
        {
          return side + "is taken by obstacle " + std::to_string(obstacle.id) +
                 (obstacle.label.empty() ? "" : " (" + obstacle.label + ")");
        }
      }
    }
  }
  if (input_.ground == nullptr)
  {
    return side + "is not visible: there is no grid of the ground";
  }
  int places = 0;
  int seen = 0;
  int occupied = 0;
  const double reach = vehicle_.half_width + SEEN_MARGIN;
  for (double length = 0.0; length <= detour.end; length += PLACE_STEP)
  {
    const Pose2 place = placeOn(detour, length);
    for (double across = -reach; across <= reach; across += CELL_STEP)
    {
      const int value = input_.ground->at(place * Eigen::Vector2d(vehicle_.front, across));
      occupied += value >= GroundGrid::OCCUPIED ? 1 : 0;
      places += length <= detour.back ? 1 : 0;
      seen += length <= detour.back && value >= 0 && value <= GroundGrid::FREE ? 1 : 0;
    }
  }
  if (occupied > MOST_OCCUPIED)
  {
    return side + "is not free";
  }
  return seen < options_.seen * places
             ? side + format("is not visible: %.0f %% of it are seen to be free", 100.0 * seen / places)
             : "";
}

/// @return why there is none; empty: found.
std::string Passing::findDetour(double blocked_at, Detour* found) const
{
  const PathProjection here = locate();
  Detour detour;
  const double lead = LEAD_S * std::max(0.0, input_.speed);
  detour.begin = here.s + lead;
  if (detour_)  // it goes on from the present path, not from the vehicle, so that the path has no bend there
  {
    const double at = lengthOn(*detour_, detour.begin);
    detour.from = detour_->at(at);
    detour.slope = detour_->slopeAt(at);
  }
  const double left = options_.left - vehicle_.half_width;
  const double right = options_.right - vehicle_.half_width;
  std::string problem = format("there is no room beside it within %.1f m left", options_.left) +
                        format(" and %.1f m right of the route", options_.right);
  const auto attempt = [&](double shift)
  {
    Detour wide = detour;
    wide.shift = shift;
    wide.shifted = shiftingLength(shift - detour.from, options_.max_curvature);
    const double returning = shiftingLength(shift, options_.max_curvature);
    wide.back = wide.end = std::numeric_limits<double>::infinity();
    if (!isClear(wide, 0.0, wide.shifted, options_.clearance))
    {
      return false;
    }
    for (double back = wide.shifted; back <= wide.shifted + MOST_BESIDE; back += 2.0 * PLACE_STEP)
    {
      wide.back = std::numeric_limits<double>::infinity();
      if (!isClear(wide, back, back + PLACE_STEP, options_.clearance))
      {
        return false;
      }
      wide.back = back;
      wide.end = back + returning;
      if (!route_.closed() && detour.begin + wide.end > route_.length())
      {
        problem = "the route ends too near behind it";
        return false;
      }
      // On the route again, it must be free for as far as another way round would need.
      const double least_end = std::max(wide.end, blocked_at - lead + options_.hold_distance);
      if (!isClear(wide, back, wide.end, options_.clearance) || !isClear(wide, wide.end, least_end, BLOCKING_MARGIN))
      {
        continue;
      }
      const std::string wrong = bendsTooMuch(wide) ? "the way round bends too much here" : problemOf(wide);
      problem = wrong.empty() ? problem : wrong;
      *found = wide;
      return wrong.empty();
    }
    return false;
  };
  for (double shift = SHIFT_STEP; shift <= std::max(left, right) + 1e-6; shift += SHIFT_STEP)
  {
    for (const double to : {shift, -shift})
    {
      if (to > left + 1e-6 || -to > right + 1e-6 || !attempt(to))
      {
        continue;
      }
      // Some more room, where there is some: beside what can hide a person, room is speed.
      const Detour least = *found;
      const double more = to + std::copysign(2.0 * SHIFT_STEP, to);
      if (more > left + 1e-6 || -more > right + 1e-6 || !attempt(more))
      {
        *found = least;
      }
      return "";
    }
  }
  return problem;
}

Path Passing::pathOf(const Detour& detour) const
{
  std::vector<Eigen::Vector2d> points;
  const std::vector<PathPoint>& along = route_.points();
  for (size_t i = 0; i + (route_.closed() ? 1 : 0) < along.size(); ++i)
  {
    const double length = lengthOn(detour, along[i].s);
    const double behind = detour_ ? detour_->at(lengthOn(*detour_, along[i].s)) : 0.0;
    const Eigen::Vector2d p = along[i].pose() * Eigen::Vector2d(0.0, length < 0.0 ? behind : detour.at(length));
    if (points.empty() || (p - points.back()).norm() > 0.01)
    {
      points.push_back(p);
    }
  }
  return Path(points, route_.closed());
}

std::string Passing::describe(const KnownObstacle& obstacle) const
{
  return (obstacle.label.empty() ? "something" : obstacle.label) +
         format(" %.1f m wide", obstacle.outline.widthFrom(input_.pose.position())) + " (obstacle " +
         std::to_string(obstacle.id) + ")";
}

void Passing::waitForPerson(PassingOutput* output) const
{
  for (const KnownObstacle& obstacle : input_.obstacles)
  {
    if (obstacle.id != passed_id_ || !isAlive(obstacle.label) || obstacle.moving)
    {
      continue;
    }
    double ahead = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector2d& corner : obstacle.outline.corners())
    {
      ahead = std::min(ahead, (input_.pose.inverse() * corner).x() - vehicle_.front);
    }
    bool on_route = false;
    for (double s = s_; !on_route && s <= s_ + options_.hold_distance + APPROACH; s += PLACE_STEP)
    {
      on_route = touches(obstacle, route_.at(s).pose(), BLOCKING_MARGIN);
    }
    if (on_route && ahead > 0.0)
    {
      output->speed_limit = std::min(output->speed_limit,
                                     std::sqrt(2.0 * limits_.deceleration * std::max(0.0, ahead - PEOPLE_CLEARANCE)));
      output->reason = describe(obstacle) + " blocks the way; it is waited for";
    }
  }
}

PassingOutput Passing::update(const PassingInput& input)
{
  PassingOutput output;
  if (route_.empty())
  {
    return output;
  }
  input_ = input;
  for (KnownObstacle& obstacle : input_.obstacles)
  {
    obstacle.outline = obstacle.outline.in(input_.pose);
    obstacle.velocity = Pose2{0.0, 0.0, input_.pose.heading} * obstacle.velocity;
  }
  s_ = locate().s;
  if (detour_)
  {
    if (lengthOn(*detour_, s_) > detour_->end)
    {
      detour_.reset();
      path_ = route_;
      output.path = path_;
    }
    else
    {
      output.speed_limit = options_.speed;
      output.obstacle_id = passed_id_;
      output.reason = std::string("passing obstacle ") + std::to_string(passed_id_) + " on the " +
                      (detour_->shift > 0.0 ? "left" : "right");
      waitForPerson(&output);
    }
  }
  const Blocker blocker = firstBlocker();
  if (blocker.obstacle == nullptr || blocker.obstacle->id != blocker_id_)
  {
    blocker_id_ = blocker.obstacle == nullptr ? -1 : blocker.obstacle->id;
    blocked_since_ns_ = input.now_ns;
  }
  if (blocker.obstacle == nullptr)
  {
    return output;
  }
  const KnownObstacle& obstacle = *blocker.obstacle;
  output.obstacle_id = obstacle.id;
  output.reason = describe(obstacle) + " blocks the way";
  const bool may_pass = std::max(options_.left, options_.right) > vehicle_.half_width;
  if (mayBePerson(obstacle, input_.pose.position()) || !may_pass)
  {
    output.reason += may_pass ? "; it is waited for" : "; nothing is passed (passing/left, right)";
    return output;
  }
  if (!looked_ || seconds(input.now_ns - looked_ns_) >= LOOK_PERIOD_S || input.now_ns < looked_ns_)
  {
    looked_ = true;
    looked_ns_ = input.now_ns;
    problem_ = "it was not there for long";
    Detour found;
    // In bends, walls that are far away seem to reach into the way for moments.
    if (std::min(obstacle.standing_s, seconds(input.now_ns - blocked_since_ns_)) >= options_.known_for)
    {
      problem_ = findDetour(blocker.distance, &found);
    }
    if (problem_.empty())
    {
      path_ = pathOf(found);
      detour_ = found;
      passed_id_ = obstacle.id;
      output.path = path_;
      output.speed_limit = options_.speed;
      output.reason = "passing " + describe(obstacle) + " on the " + (found.shift > 0.0 ? "left" : "right");
      return output;
    }
  }
  if (input_.ground != nullptr)  // without it there is nothing to wait for
  {
    output.speed_limit =
        std::min(output.speed_limit,
                 std::sqrt(2.0 * limits_.deceleration * std::max(0.0, blocker.distance - options_.hold_distance)));
  }
  output.reason += "; " + problem_;
  return output;
}

}  // namespace pi_vehicle
