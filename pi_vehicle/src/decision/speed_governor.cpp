#include "decision/speed_governor.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle
{

using pi_node::seconds;

namespace
{

constexpr double TIME_STEP = 0.1;         // of predictions [s]
constexpr double SPEED_STEP = 0.1;        // between speeds that are tried [m/s]
constexpr double WAY_STEP = 0.1;          // of the arc, if no way is given [m]
constexpr double TRACK_S = 3.0;           // dead reckoning is kept for so long [s]
constexpr double LEAST_MARGIN = 0.05;     // of an obstacle that is already closer than the margin [m]
constexpr double EMERGENCY_GAP = 0.15;    // left after emergency braking, on top of the least margin [m]
constexpr double LEAST_HALF_SIZE = 0.1;   // of an obstacle's box [m]
constexpr double STANDING_S = 1.0;        // the place of the stop must stay free for this time [s]
constexpr double ROLLING_S = 0.3;         // clear_persistence of a vehicle that has not come to a stop yet
constexpr double MAX_UPDATE_S = 1.0;      // a longer pause resets the governor
constexpr double HIDING_SEEN_FROM = 4.0;  // nearer, outlines change with what has left the picture [m]
constexpr double KNOWN_AFTER_S = 0.6;     // of being followed: then it is clear how it moves
constexpr double OUT_OF_VIEW_S = 1.5;     // for which who came out and left the view walks on, who left it walking runs
constexpr double LOST_S = 0.15;           // unseen for longer, it is not one picture that failed
constexpr double FOLLOWS_LIMIT = 0.2;     // above a limit that falls, comfortable braking follows it [m/s]
constexpr double LATE_FOR_LIMIT = 0.7;    // so much above it takes emergency braking, between the two a part [m/s]
constexpr char PERSON[] = "person";
constexpr double REACH_STEP = 0.5;  // along the way, to see which obstacles are far from it [m]

/// Distance covered within `t` by driving `speed` for `reaction` and then braking.
double brakingDistance(double speed, double deceleration, double reaction, double t)
{
  const double braking = std::clamp(t - reaction, 0.0, speed / deceleration);
  return speed * std::min(t, reaction) + speed * braking - 0.5 * deceleration * braking * braking;
}

}  // namespace

void SpeedGovernorOptions::validate() const
{
  footprint.validate();
  limits.validate();
  const pi_node::OptionCheck check("governor");
  check.range("reaction_time", reaction_time, 0.0, 3.0);
  check.range("margin", margin, 0.05, 5.0);
  check.range("stop_gap", stop_gap, 0.0, 10.0);
  check.range("headway", headway, 0.0, 10.0);
  check.range("min_moving_speed", min_moving_speed, 0.0, 5.0);
  check.range("horizon", horizon, 0.5, 30.0);
  check.range("pass_time_margin", pass_time_margin, 0.0, 10.0);
  check.range("close_speed", close_speed, 0.0, 10.0);
  check.range("memory", memory, 0.0, 10.0);
  check.range("clear_persistence", clear_persistence, 0.0, 60.0);
  check.range("min_speed", min_speed, 0.0, limits.speed, "vehicle/limits/speed");
  check.range("resume_speed", resume_speed, min_speed, limits.speed, "vehicle/limits/speed");
  check.range("rise", rise, 0.05, 100.0);
  check.range("obstacles_timeout", obstacles_timeout, 0.02, 60.0);
  check.range("step_out_speed", step_out_speed, 0.0, 10.0);
  check.range("child_speed", child_speed, 0.0, 10.0);
  check.range("step_out_reaction_time", step_out_reaction_time, 0.0, 3.0);
}

SpeedGovernor::SpeedGovernor(const SpeedGovernorOptions& options) : options_(options)
{
  options_.validate();
}

void SpeedGovernor::reset()
{
  known_.clear();
  track_.clear();
  reported_ = false;
  limit_ = 0.0;
  standing_ = false;
}

Pose2 SpeedGovernor::poseAt(int64_t stamp_ns) const
{
  if (track_.empty())
  {
    return Pose2();
  }
  if (stamp_ns >= track_.back().first)
  {
    return track_.back().second;
  }
  for (size_t i = track_.size() - 1; i > 0; --i)
  {
    const auto& [from, a] = track_[i - 1];
    const auto& [to, b] = track_[i];
    if (stamp_ns >= from)
    {
      const double part = static_cast<double>(stamp_ns - from) / static_cast<double>(to - from);
      return {a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.heading + part * wrapAngle(b.heading - a.heading)};
    }
  }
  return track_.front().second;
}

bool SpeedGovernor::setObstacles(int64_t stamp_ns, const std::vector<ObstacleBox>& obstacles)
{
  if (reported_ && stamp_ns <= report_ns_)
  {
    if (report_ns_ - stamp_ns <= 1000000000)
    {
      return false;
    }
    reset();
  }
  reported_ = true;
  report_ns_ = stamp_ns;
  const Pose2 pose = poseAt(stamp_ns);
  bool complete = true;
  for (const ObstacleBox& box : obstacles)
  {
    if (!box.position.allFinite() || !box.size.allFinite() || !box.velocity.allFinite())
    {
      complete = false;
      continue;
    }
    Known known;
    known.id = box.id;
    known.seen_ns = stamp_ns;
    if (GroundPolygon::isOutline(box.outline))
    {
      known.outline = GroundPolygon(box.outline).in(pose);
    }
    else
    {
      complete = complete && box.outline.empty();
      const Eigen::Vector2d p = pose * box.position;
      known.outline = GroundPolygon::box({p.x(), p.y(), pose.heading}, (0.5 * box.size).cwiseMax(LEAST_HALF_SIZE));
    }
    known.moving = box.moving;
    known.label = box.label;
    known.top = box.top;
    known.standing_since_ns = stamp_ns;
    known.followed_s = box.followed_s;
    known.unseen_s = box.unseen_s;
    known.out_of = -1;
    known.walks = 0.0;
    known.hidden = hidden_people::behind(known.outline, pose.position(), box.top);
    known.hiding = known.outline;
    const bool near = (known.outline.middle() - pose.position()).norm() < HIDING_SEEN_FROM;
    known.velocity = Pose2{0.0, 0.0, pose.heading} * box.velocity;
    const auto same =
        std::find_if(known_.begin(), known_.end(), [&box](const Known& other) { return other.id == box.id; });
    if (same == known_.end())
    {
      known_.push_back(known);
    }
    else
    {
      if (near)
      {
        known.hidden = same->hidden;
        known.hiding = isMoving(known) ? known.outline : same->hiding;
      }
      known.out_of = same->out_of;
      known.walks = same->walks;
      known.standing_since_ns = isMoving(known) ? stamp_ns : same->standing_since_ns;
      *same = known;
    }
  }
  return complete;
}

SpeedGovernor::Placed SpeedGovernor::alongWay(double s) const
{
  const auto placed = [](const Pose2& pose) {
    return Placed{pose.position(), {std::cos(pose.heading), std::sin(pose.heading)}};
  };
  if (s >= way_s_.back())
  {
    return placed(way_.back().moved(s - way_s_.back(), 0.0));
  }
  const auto after = std::upper_bound(way_s_.begin() + 1, way_s_.end() - 1, s);
  const auto i = static_cast<size_t>(after - way_s_.begin());
  const double part = std::clamp((s - way_s_[i - 1]) / (way_s_[i] - way_s_[i - 1]), 0.0, 1.0);
  const Pose2& a = way_[i - 1];
  const Pose2& b = way_[i];
  return placed(
      {a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.heading + part * wrapAngle(b.heading - a.heading)});
}

void SpeedGovernor::setWay(const GovernorInput& input)
{
  way_ = input.way;
  if (way_.size() < 2)
  {
    way_.clear();
    for (double s = 0.0; s < options_.limits.speed * options_.horizon; s += WAY_STEP)
    {
      way_.push_back(Pose2().moved(s, input.curvature));
    }
  }
  way_s_.assign(1, 0.0);
  for (size_t i = 1; i < way_.size(); ++i)
  {
    way_s_.push_back(way_s_.back() + std::max(1e-6, (way_[i].position() - way_[i - 1].position()).norm()));
  }
  const double speed = std::max(0.0, input.speed);
  at_speed_.clear();
  for (double t = 0.0; t <= options_.horizon; t += TIME_STEP)
  {
    at_speed_.push_back(alongWay(speed * t));
  }
  const double fastest = std::max(speed, options_.limits.speed);
  const double most = std::max(speed * options_.horizon, fastest * options_.reaction_time +
                                                             0.5 * fastest * fastest / options_.limits.deceleration);
  reach_.clear();
  for (double s = 0.0; s < most + REACH_STEP; s += REACH_STEP)
  {
    reach_.push_back(alongWay(s));
  }
  const auto steps = static_cast<size_t>(options_.limits.speed / SPEED_STEP) + 2;
  comfortable_.assign(steps, {});
  emergency_.assign(steps, {});
}

std::vector<SpeedGovernor::Placed> SpeedGovernor::makeBrakingPlaces(double speed, double deceleration) const
{
  const double standing = options_.reaction_time + speed / deceleration;
  std::vector<Placed> places;
  for (double t = 0.0; t <= standing + STANDING_S; t += TIME_STEP)
  {
    places.push_back(alongWay(brakingDistance(speed, deceleration, options_.reaction_time, t)));
  }
  return places;
}

const std::vector<SpeedGovernor::Placed>& SpeedGovernor::brakingPlaces(size_t speed_steps, bool emergency)
{
  std::vector<Placed>& places = (emergency ? emergency_ : comfortable_)[speed_steps];
  if (places.empty())
  {
    places = makeBrakingPlaces(SPEED_STEP * static_cast<double>(speed_steps),
                               emergency ? options_.limits.emergency_deceleration : options_.limits.deceleration);
  }
  return places;
}

bool SpeedGovernor::isFar(const Local& obstacle) const
{
  const double ahead = std::max(
      options_.footprint.front + options_.margin + options_.stop_gap + options_.headway * options_.limits.speed,
      options_.footprint.rear + LEAST_MARGIN);
  const double vehicle = std::hypot(std::max(ahead, options_.footprint.front + options_.margin + EMERGENCY_GAP),
                                    options_.footprint.half_width + options_.margin);
  const double moves = obstacle.velocity.norm() * (options_.horizon + options_.pass_time_margin);
  const double reach = vehicle + moves + obstacle.outline.radius() + 0.5 * REACH_STEP;
  return std::all_of(reach_.begin(), reach_.end(),
                     [&](const Placed& place)
                     { return (place.position - obstacle.outline.middle()).squaredNorm() > reach * reach; });
}

bool SpeedGovernor::touches(const Local& obstacle, double t, const Placed& vehicle, double extra_front,
                            double margin) const
{
  const double front = options_.footprint.front + margin + extra_front;
  const double rear = options_.footprint.rear + LEAST_MARGIN;
  const GroundRectangle rectangle{vehicle.position + 0.5 * (front - rear) * vehicle.along,
                                  vehicle.along,
                                  {0.5 * (front + rear), options_.footprint.half_width + margin}};
  return obstacle.outline.overlaps(rectangle, t * obstacle.velocity);
}

bool SpeedGovernor::brakes(const Local& obstacle, const std::vector<Placed>& places, double standing_s, double gap,
                           double margin, bool frozen) const
{
  const bool moving = obstacle.moving && !frozen;
  // A pedestrian who walks up to the standing vehicle is no reason to stop elsewhere.
  const double end = moving ? std::min(options_.horizon, standing_s + STANDING_S) : standing_s + TIME_STEP;
  for (size_t i = 0; i < places.size() && TIME_STEP * static_cast<double>(i) <= end; ++i)
  {
    if (touches(obstacle, moving ? TIME_STEP * static_cast<double>(i) : 0.0, places[i], gap, margin))
    {
      return false;
    }
  }
  return true;
}

bool SpeedGovernor::passes(const Local& obstacle) const
{
  for (size_t i = 0; i < at_speed_.size(); ++i)
  {
    const double t = TIME_STEP * static_cast<double>(i);
    const double times[] = {t, std::max(0.0, t - options_.pass_time_margin), t + options_.pass_time_margin};
    for (const double at : times)
    {
      if (touches(obstacle, obstacle.moving ? at : 0.0, at_speed_[i], 0.0, obstacle.margin))
      {
        return false;
      }
    }
  }
  return true;
}

double SpeedGovernor::timeToCollision(const Local& obstacle) const
{
  for (size_t i = 0; i < at_speed_.size(); ++i)
  {
    const double t = TIME_STEP * static_cast<double>(i);
    if (touches(obstacle, obstacle.moving ? t : 0.0, at_speed_[i], 0.0, 0.0))
    {
      return t;
    }
  }
  return std::numeric_limits<double>::infinity();
}

double SpeedGovernor::clearance(const Local& obstacle) const
{
  const Placed HERE{Eigen::Vector2d::Zero(), Eigen::Vector2d::UnitX()};
  for (double margin = 0.0; margin < options_.margin; margin += 0.02)
  {
    if (touches(obstacle, 0.0, HERE, 0.0, margin))
    {
      return margin;
    }
  }
  return options_.margin;
}

double SpeedGovernor::speedBeside(const Local& obstacle) const
{
  if (obstacle.hidden == hidden_people::Who::NOBODY)
  {
    return options_.limits.speed;
  }
  hidden_people::Vehicle vehicle;
  vehicle.front = options_.footprint.front;
  vehicle.deceleration = options_.limits.deceleration;
  vehicle.emergency_deceleration = options_.limits.emergency_deceleration;
  vehicle.brakes_delay = options_.reaction_time;
  vehicle.reaction_time = options_.step_out_reaction_time;
  const hidden_people::Edge edge = hidden_people::edgeOf(obstacle.hiding, way_, options_.footprint.half_width);
  const bool adult = obstacle.hidden == hidden_people::Who::ADULT;
  return hidden_people::allowedSpeed(edge, adult ? options_.step_out_speed : options_.child_speed, vehicle);
}

double SpeedGovernor::timeGap(const Local& obstacle, double speed) const
{
  return options_.stop_gap + (obstacle.moving ? options_.headway * speed : 0.0);
}

bool SpeedGovernor::stopsInTime(const Local& obstacle, size_t speed_steps)
{
  const double speed = SPEED_STEP * static_cast<double>(speed_steps);
  const double reaction = options_.reaction_time;
  const bool comfortably =
      brakes(obstacle, brakingPlaces(speed_steps, false), reaction + speed / options_.limits.deceleration,
             timeGap(obstacle, speed), obstacle.margin, false);
  return comfortably && (!obstacle.moving || brakes(obstacle, brakingPlaces(speed_steps, true),
                                                    reaction + speed / options_.limits.emergency_deceleration, 0.0,
                                                    leastMargin(obstacle), true));
}

double SpeedGovernor::leastMargin(const Local& obstacle) const
{
  return std::min(obstacle.margin, LEAST_MARGIN);
}

double SpeedGovernor::stoppableSpeed(const Local& obstacle, double bound)
{
  double stoppable = 0.0;
  bool any = false;
  for (size_t step = 0; SPEED_STEP * static_cast<double>(step) <= bound + 1e-9 && stopsInTime(obstacle, step); ++step)
  {
    stoppable = SPEED_STEP * static_cast<double>(step);
    any = true;
  }
  return any && stoppable > bound - SPEED_STEP ? bound : stoppable;
}

double SpeedGovernor::deadReckon(const GovernorInput& input)
{
  double dt = track_.empty() ? 0.0 : seconds(input.now_ns - last_ns_);
  if (dt < 0.0 || dt > MAX_UPDATE_S)
  {
    reset();
    dt = 0.0;
  }
  last_ns_ = input.now_ns;
  const Pose2 last = track_.empty() ? Pose2() : track_.back().second;
  if (track_.empty() || dt > 0.0)
  {
    track_.emplace_back(input.now_ns, last.moved(input.speed * dt, input.curvature));
  }
  while (seconds(input.now_ns - track_.front().first) > TRACK_S)
  {
    track_.pop_front();
  }
  return dt;
}

void SpeedGovernor::forgetUnseen(int64_t now_ns)
{
  known_.erase(std::remove_if(known_.begin(), known_.end(),
                              [this, now_ns](const Known& known) {
                                return known.seen_ns < report_ns_ && seconds(now_ns - known.seen_ns) > options_.memory;
                              }),
               known_.end());
}

bool SpeedGovernor::isMoving(const Known& known) const
{
  return known.moving && known.velocity.norm() >= options_.min_moving_speed;
}

Eigen::Vector2d SpeedGovernor::velocityOf(const Known& known, const Pose2& T_base_reckoned) const
{
  return isMoving(known) ? Pose2{0.0, 0.0, T_base_reckoned.heading} * known.velocity : Eigen::Vector2d(0.0, 0.0);
}

GroundPolygon SpeedGovernor::outlineNow(const Known& known, const Pose2& T_base_reckoned, int64_t now_ns) const
{
  const double age = std::max(0.0, seconds(now_ns - known.seen_ns));
  return known.outline.in(T_base_reckoned, age * velocityOf(known, T_base_reckoned));
}

std::vector<KnownObstacle> SpeedGovernor::obstacles() const
{
  std::vector<KnownObstacle> obstacles;
  const Pose2 T_base_reckoned = track_.empty() ? Pose2() : track_.back().second.inverse();
  for (const Known& known : known_)
  {
    obstacles.push_back({known.id, outlineNow(known, T_base_reckoned, last_ns_), velocityOf(known, T_base_reckoned),
                         isMoving(known), seconds(last_ns_ - known.standing_since_ns), known.top, known.label});
  }
  return obstacles;
}

bool SpeedGovernor::canBePerson(const Known& known)
{
  return known.label.empty() || known.label == PERSON;
}

void SpeedGovernor::findNewcomers()
{
  const Pose2 T_base_reckoned = track_.back().second.inverse();
  for (Known& known : known_)
  {
    if (!canBePerson(known) || known.followed_s > KNOWN_AFTER_S)
    {
      continue;
    }
    const GroundPolygon seen = known.outline.in(T_base_reckoned);
    if (known.out_of >= 0)
    {
      // What became larger is a thing whose end was seen first.
      known.out_of = hidden_people::isNotWiderThanPerson(seen, way_.front().position()) ? known.out_of : -1;
      continue;
    }
    const Eigen::Vector2d velocity = Pose2{0.0, 0.0, T_base_reckoned.heading} * known.velocity;
    for (const Known& hider : known_)
    {
      if (hider.hidden != hidden_people::Who::NOBODY && hider.followed_s > KNOWN_AFTER_S && !isMoving(hider) &&
          hidden_people::comesOut(seen, velocity, hider.hiding.in(T_base_reckoned), way_))
      {
        known.out_of = hider.id;
        known.walks = hider.hidden == hidden_people::Who::ADULT ? options_.step_out_speed : options_.child_speed;
        break;
      }
    }
  }
}

void SpeedGovernor::letWalk(const Known& known, int64_t now_ns, Local* local) const
{
  if (local->moving || known.out_of < 0 || known.followed_s > KNOWN_AFTER_S || known.unseen_s > OUT_OF_VIEW_S)
  {
    return;
  }
  local->moving = true;
  local->out_of = known.out_of;
  local->hidden = hidden_people::Who::NOBODY;
  local->velocity = known.walks * hidden_people::towards(way_, local->outline.middle());
  const double since = std::max(0.0, seconds(now_ns - known.seen_ns)) + known.unseen_s;
  local->outline = local->outline.in(Pose2(), since * local->velocity);
}

void SpeedGovernor::letRun(const Known& known, Local* local) const
{
  if (!local->moving || !canBePerson(known) || known.unseen_s < LOST_S || known.unseen_s > OUT_OF_VIEW_S)
  {
    return;
  }
  const Eigen::Vector2d towards = hidden_people::towards(way_, local->outline.middle());
  const double speed = local->velocity.dot(towards);
  if (speed < options_.min_moving_speed || speed > options_.step_out_speed)
  {
    return;
  }
  const Eigen::Vector2d faster = (options_.step_out_speed - speed) * towards;
  local->velocity += faster;
  local->outline = local->outline.in(Pose2(), known.unseen_s * faster);
}

std::vector<SpeedGovernor::Local> SpeedGovernor::nearTheWay(int64_t now_ns) const
{
  const Pose2 T_base_reckoned = track_.back().second.inverse();
  std::vector<Local> obstacles;
  for (const Known& known : known_)
  {
    Local local;
    local.id = known.id;
    local.moving = isMoving(known);
    local.hidden = local.moving ? hidden_people::Who::NOBODY : known.hidden;
    local.velocity = velocityOf(known, T_base_reckoned);
    local.outline = outlineNow(known, T_base_reckoned, now_ns);
    local.hiding = known.hiding.in(T_base_reckoned);
    letRun(known, &local);
    letWalk(known, now_ns, &local);
    const bool behind = local.outline.mostX() < -options_.footprint.rear;
    if (behind || isFar(local))
    {
      continue;
    }
    local.margin = options_.margin;
    const double clear = clearance(local);
    if (clear < options_.margin)
    {
      local.margin = std::max(0.0, std::min(clear - 0.02, options_.margin));
    }
    obstacles.push_back(local);
  }
  return obstacles;
}

SpeedGovernor::Bound SpeedGovernor::boundBy(const std::vector<Local>& obstacles, double speed)
{
  const std::vector<Placed> braking_now = makeBrakingPlaces(speed, options_.limits.deceleration);
  Bound bound;
  bound.speed = options_.limits.speed;
  for (const Local& obstacle : obstacles)
  {
    double own = stoppableSpeed(obstacle, bound.speed);
    if (obstacle.margin < options_.margin)
    {
      own = std::min(own, options_.close_speed);
    }
    bound.time_to_collision = std::min(bound.time_to_collision, timeToCollision(obstacle));
    if (own >= bound.speed)
    {
      continue;
    }
    if (own < speed && obstacle.moving && speed > options_.resume_speed && passes(obstacle))
    {
      own = std::min(speed, bound.speed);
    }
    else if (speed > options_.min_speed && own < speed &&
             !brakes(obstacle, braking_now, options_.reaction_time + speed / options_.limits.deceleration,
                     EMERGENCY_GAP, leastMargin(obstacle), false))
    {
      bound.emergency = true;
    }
    // Only an emergency stops the vehicle for somebody who may be nobody.
    own = obstacle.out_of < 0 ? own : std::max(own, std::min(bound.speed, options_.close_speed));
    if (own < bound.speed)
    {
      bound.speed = own;
      bound.by_moving = obstacle.moving;
      bound.obstacle_id = obstacle.id;
      bound.out_of = obstacle.out_of;
    }
  }
  // Only now: a lower bound would hide emergencies.
  for (const Local& obstacle : obstacles)
  {
    const double beside = speedBeside(obstacle);
    if (beside < bound.speed)
    {
      bound.speed = beside;
      bound.by_moving = false;
      bound.by_hidden = true;
      bound.obstacle_id = obstacle.id;
      bound.out_of = -1;
    }
  }
  return bound;
}

bool SpeedGovernor::mayResume(const Bound& bound, double speed, int64_t now_ns, std::string* reason)
{
  const bool clear = bound.speed >= options_.resume_speed;
  if (!clear || !was_clear_)
  {
    clear_since_ns_ = now_ns;
  }
  was_clear_ = clear;
  // A pedestrian who leaves the path may stop in it, so braking continues until the path has been free for the full
  // time.
  const bool rolls = speed > options_.min_speed && !bound.by_moving;
  const double persistence = rolls ? std::min(ROLLING_S, options_.clear_persistence) : options_.clear_persistence;
  if (clear && seconds(now_ns - clear_since_ns_) >= persistence)
  {
    return true;
  }
  *reason = clear ? "waiting until the way has been clear for long enough" : "waiting for a clear way";
  return false;
}

GovernorOutput SpeedGovernor::stop(const std::string& reason, GovernorOutput output)
{
  limit_ = 0.0;
  standing_ = true;
  was_clear_ = false;
  output.speed_limit = 0.0;
  output.reason = reason;
  return output;
}

GovernorOutput SpeedGovernor::update(const GovernorInput& input)
{
  GovernorOutput output;
  output.max_deceleration = options_.limits.deceleration;
  if (!std::isfinite(input.speed) || !std::isfinite(input.curvature) ||
      !std::all_of(input.way.begin(), input.way.end(), [](const Pose2& pose) { return pose.finite(); }))
  {
    return stop("speed, curvature or way is not a number", output);
  }
  const double dt = deadReckon(input);
  if (!reported_ || seconds(input.now_ns - report_ns_) > options_.obstacles_timeout)
  {
    return stop(pi_node::format("no report of obstacles for %.1f s", options_.obstacles_timeout), output);
  }
  setWay(input);
  forgetUnseen(input.now_ns);
  findNewcomers();
  const double speed = std::max(0.0, input.speed);
  const Bound bound = boundBy(nearTheWay(input.now_ns), speed);
  output.obstacle_id = bound.obstacle_id;
  output.time_to_collision = bound.time_to_collision;
  const std::string id = std::to_string(bound.obstacle_id);
  const std::string out_of =
      bound.out_of < 0 ? "" : ", which came out from behind obstacle " + std::to_string(bound.out_of);
  if (bound.emergency)
  {
    output.max_deceleration = options_.limits.emergency_deceleration;
    output.emergency = true;
    return stop("emergency braking for obstacle " + id + out_of + ", time to collision " +
                    pi_node::format("%.1f s", bound.time_to_collision),
                output);
  }
  if (bound.speed < options_.min_speed)
  {
    return stop("stopping for obstacle " + id, output);
  }
  if (standing_)
  {
    if (!mayResume(bound, speed, input.now_ns, &output.reason))
    {
      return output;
    }
    standing_ = false;
    limit_ = std::max(limit_, speed);
  }
  // The limit falls at once and rises slowly; a standing vehicle may start with min_speed.
  limit_ = std::min(bound.speed, std::max(limit_, speed) + options_.rise * dt);
  limit_ = std::min(bound.speed, std::max(limit_, options_.min_speed));
  output.speed_limit = limit_;
  if (bound.by_hidden || bound.by_moving)
  {
    // A limit that was known late, or fell since somebody halted in the way, is not made up for by braking as it falls.
    const double late = std::clamp((speed - limit_ - FOLLOWS_LIMIT) / (LATE_FOR_LIMIT - FOLLOWS_LIMIT), 0.0, 1.0);
    output.max_deceleration += late * (options_.limits.emergency_deceleration - options_.limits.deceleration);
  }
  if (output.obstacle_id >= 0)
  {
    output.reason = bound.by_hidden ? "slowing beside obstacle " + id + ", which may hide a person"
                                    : "slowing for obstacle " + id + out_of;
  }
  return output;
}

}  // namespace pi_vehicle
