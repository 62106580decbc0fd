#include "decision/path_follower.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle
{

using pi_node::format;
using pi_node::seconds;

namespace
{

constexpr double STANDING = 0.05;     // [m/s]
constexpr double CREEP = 0.1;         // least speed near the goal [m/s]
constexpr double STOP_SHORT = 0.05;   // distance to the goal at which speed 0 is commanded [m]
constexpr double SEARCH_BACK = 1.0;   // for the nearest place, behind the last one [m]
constexpr double SEARCH_AHEAD = 3.0;  // likewise ahead [m]
constexpr double HEADING_WEIGHT =
    1.0;  // one radian of heading error counts as this distance in a search of the whole path [m]
constexpr double MAX_STEP_S = 0.2;  // longest time step of ramps and blends [s]
constexpr double SCAN_STEP = 0.2;   // of the planned speed, along the path [m]

}  // namespace

void PathFollowerOptions::validate() const
{
  limits.validate();
  const pi_node::OptionCheck check("follower");
  check.range("acceleration", acceleration, 0.05, limits.acceleration, "vehicle/limits/acceleration");
  check.range("deceleration", deceleration, 0.05, limits.deceleration, "vehicle/limits/deceleration");
  check.range("stop_deceleration", stop_deceleration, 0.05, limits.emergency_deceleration,
              "vehicle/limits/emergency_deceleration");
  check.range("max_lateral_acceleration", max_lateral_acceleration, 0.05, limits.lateral_acceleration,
              "vehicle/limits/lateral_acceleration");
  check.range("look_ahead_min", look_ahead_min, 0.1, 10.0);
  check.range("look_ahead_time", look_ahead_time, 0.0, 10.0);
  check.range("look_ahead_max", look_ahead_max, look_ahead_min, 50.0);
  check.range("actuation_delay", actuation_delay, 0.0, 2.0);
  check.range("rejoin_speed", rejoin_speed, 0.05, limits.speed, "vehicle/limits/speed");
  check.range("rejoin_offset", rejoin_offset, 0.05, 10.0);
  check.range("rejoin_heading", rejoin_heading, 0.05, M_PI);
  check.range("max_offset", max_offset, rejoin_offset, 50.0);
  check.range("goal_tolerance", goal_tolerance, 0.02, 5.0);
  check.range("localisation_timeout", localisation_timeout, 0.02, 10.0);
  check.range("jump_small", jump_small, 0.01, 10.0);
  check.range("jump_large", jump_large, jump_small, 100.0);
  check.range("jump_large_heading", jump_large_heading, 0.01, M_PI);
  check.range("jump_blend_time", jump_blend_time, 0.05, 60.0);
  check.range("jump_settle_time", jump_settle_time, 0.0, 3600.0);
}

PathFollower::PathFollower(const PathFollowerOptions& options) : options_(options)
{
  options_.validate();
}

void PathFollower::setPath(const Path& path)
{
  path_ = path;
  located_ = false;
  s_ = 0.0;
  done_ = false;
  missed_ = false;
  jumped_ = false;
  offset_ = Pose2();
}

void PathFollower::clear()
{
  setPath(Path());
}

void PathFollower::resume()
{
  jumped_ = false;
  located_ = false;
}

FollowerOutput PathFollower::stopped(FollowerStop stop, const std::string& reason, FollowerOutput output)
{
  speed_ = 0.0;
  output.state = FollowerState::STOPPED;
  output.stop = stop;
  output.command.speed = 0.0;
  output.command.curvature = curvature_;
  output.command.max_deceleration = options_.stop_deceleration;
  output.command.reason = reason;
  return output;
}

void PathFollower::compareWithPrediction(const FollowerInput& input)
{
  const double dt = std::max(0.0, seconds(input.pose_stamp_ns - pose_stamp_ns_));
  const Pose2 predicted = raw_pose_.moved(input.speed * dt, input.curvature);
  const Eigen::Vector2d shift = predicted.position() - input.pose->position();
  const double turn = wrapAngle(predicted.heading - input.pose->heading);
  const double decay = std::exp(-dt / options_.jump_blend_time);
  offset_ = {offset_.x * decay, offset_.y * decay, offset_.heading * decay};
  if (shift.norm() >= options_.jump_large || std::abs(turn) >= options_.jump_large_heading)
  {
    jumped_ = true;
    located_ = false;
    settled_since_ns_ = input.now_ns;
    offset_ = Pose2();
  }
  else if (shift.norm() > options_.jump_small)
  {
    if (jumped_)
    {
      settled_since_ns_ = input.now_ns;
    }
    else
    {
      offset_ = {offset_.x + shift.x(), offset_.y + shift.y(), wrapAngle(offset_.heading + turn)};
    }
  }
}

FollowerStop PathFollower::takePose(const FollowerInput& input)
{
  if (!input.pose)
  {
    return FollowerStop::NO_LOCALISATION;
  }
  if (!input.pose->finite() || !std::isfinite(input.speed) || !std::isfinite(input.curvature))
  {
    return FollowerStop::BAD_INPUT;
  }
  if (have_pose_ && input.pose_stamp_ns != pose_stamp_ns_)
  {
    compareWithPrediction(input);
  }
  if (!have_pose_ || input.pose_stamp_ns != pose_stamp_ns_)
  {
    have_pose_ = true;
    pose_stamp_ns_ = input.pose_stamp_ns;
    raw_pose_ = *input.pose;
  }
  const double age = seconds(input.now_ns - input.pose_stamp_ns);
  if (age > options_.localisation_timeout || age < -options_.localisation_timeout)
  {
    return FollowerStop::STALE_LOCALISATION;
  }
  if (jumped_ && options_.jump_settle_time > 0.0 &&
      seconds(input.now_ns - settled_since_ns_) >= options_.jump_settle_time)
  {
    resume();
  }
  return jumped_ ? FollowerStop::LOCALISATION_JUMPED : FollowerStop::NONE;
}

double PathFollower::pursuit(const Pose2& pose, double s, double cross_track, double speed) const
{
  const double look_ahead = std::min(
      options_.look_ahead_max, options_.look_ahead_min + options_.look_ahead_time * speed + std::abs(cross_track));
  Eigen::Vector2d target;
  if (!path_.closed() && s + look_ahead > path_.length())
  {
    // The path is prolonged straight beyond the goal, so that the steering stays calm.
    const PathPoint end = path_.points().back();
    target = end.pose() * Eigen::Vector2d(s + look_ahead - path_.length(), 0.0);
  }
  else
  {
    target = path_.at(s + look_ahead).pose().position();
  }
  const Eigen::Vector2d local = pose.inverse() * target;
  const double squared = std::max(local.squaredNorm(), 1e-6);
  double curvature = 2.0 * local.y() / squared;
  if (local.x() < 0.0)
  {
    curvature = std::copysign(options_.limits.curvature, local.y());  // behind: turn round
  }
  return std::clamp(curvature, -options_.limits.curvature, options_.limits.curvature);
}

double PathFollower::plannedSpeed(double s, double speed) const
{
  double planned = options_.limits.speed;
  const double reach = speed * speed / (2.0 * options_.deceleration) + 2.0 * speed + 1.0;
  const double end = path_.closed() ? s + reach : std::min(s + reach, path_.length());
  for (double at = s; at < end; at += SCAN_STEP)
  {
    const double curvature = std::abs(path_.at(at).curvature);
    const double squared = options_.max_lateral_acceleration / std::max(curvature, 1e-6);
    planned = std::min(planned, std::sqrt(squared + 2.0 * options_.deceleration * (at - s)));
  }
  if (!path_.closed())
  {
    const double remaining = path_.length() - s;
    planned = std::min(planned, std::max(CREEP, std::sqrt(2.0 * options_.deceleration * remaining)));
  }
  return planned;
}

double PathFollower::advanceClock(int64_t now_ns)
{
  const double dt = have_now_ ? seconds(now_ns - last_now_ns_) : 0.0;
  if (dt < 0.0)
  {
    have_pose_ = false;  // the clock went back
    located_ = false;
  }
  have_now_ = true;
  last_now_ns_ = now_ns;
  return std::clamp(dt, 0.0, MAX_STEP_S);
}

std::string PathFollower::reasonOf(FollowerStop trouble, const FollowerInput& input) const
{
  switch (trouble)
  {
    case FollowerStop::NO_LOCALISATION:
      return "no localisation";
    case FollowerStop::BAD_INPUT:
      return "pose, speed or curvature is not a number";
    case FollowerStop::STALE_LOCALISATION:
      return format("pose is %.2f s old, must be within %.2f s", seconds(input.now_ns - input.pose_stamp_ns),
                    options_.localisation_timeout);
    default:
      return format("localisation jumped by %.2f m or %.2f rad or more", options_.jump_large,
                    options_.jump_large_heading);
  }
}

Pose2 PathFollower::poseWhenCommandActs(const FollowerInput& input)
{
  const Pose2 blended{raw_pose_.x + offset_.x, raw_pose_.y + offset_.y, wrapAngle(raw_pose_.heading + offset_.heading)};
  const double age = std::max(0.0, seconds(input.now_ns - pose_stamp_ns_));
  steered_ = blended.moved(input.speed * age, input.curvature);
  have_steered_ = true;
  return steered_.moved(input.speed * options_.actuation_delay, input.curvature);
}

double PathFollower::distanceTo(double s, const Pose2& pose) const
{
  return (path_.at(s).pose().position() - pose.position()).norm();
}

PathProjection PathFollower::locate(const Pose2& pose) const
{
  if (located_)
  {
    const PathProjection near = path_.project(pose, s_ - SEARCH_BACK, s_ + SEARCH_AHEAD);
    if (distanceTo(near.s, pose) <= options_.max_offset)
    {
      return near;
    }
  }
  return path_.project(pose, HEADING_WEIGHT);
}

bool PathFollower::reachedEnd(double distance_to_goal) const
{
  return !path_.closed() &&
         (done_ || missed_ || distance_to_goal <= std::min(STOP_SHORT, 0.25 * options_.goal_tolerance));
}

FollowerOutput PathFollower::stopAtGoal(double measured_speed, FollowerOutput output)
{
  const double goal_offset = (path_.points().back().pose().position() - steered_.position()).norm();
  speed_ = 0.0;
  output.command.curvature = curvature_;
  if (!done_ && std::abs(measured_speed) < STANDING)
  {
    done_ = goal_offset <= options_.goal_tolerance;
    missed_ = !done_;
  }
  if (missed_)
  {
    return stopped(FollowerStop::GOAL_MISSED,
                   format("the path ends %.2f m from here, must be within %.2f m: plan again", goal_offset,
                          options_.goal_tolerance),
                   output);
  }
  output.state = done_ ? FollowerState::DONE : FollowerState::FOLLOWING;
  output.command.max_deceleration = done_ ? 0.0 : options_.stop_deceleration;
  output.command.reason = done_ ? "at the goal" : "stopping at the goal";
  output.progress = done_ ? 1.0 : output.progress;
  return output;
}

void PathFollower::drive(const FollowerInput& input, const PathProjection& projection, double lateral_error, double dt,
                         FollowerOutput* output)
{
  const double wanted = pursuit(output->pose, s_, projection.cross_track, std::abs(input.speed));
  const double turn = options_.limits.curvature_rate * dt;
  curvature_ = std::clamp(wanted, curvature_ - turn, curvature_ + turn);

  double limit = plannedSpeed(s_, std::abs(input.speed));
  const double bend = std::max(std::abs(curvature_), std::abs(wanted));
  limit = std::min(limit, std::sqrt(options_.max_lateral_acceleration / std::max(bend, 1e-6)));
  const bool rejoining =
      lateral_error > options_.rejoin_offset || std::abs(projection.heading_error) > options_.rejoin_heading;
  if (rejoining)
  {
    limit = std::min(limit, options_.rejoin_speed);
  }
  // Accelerates from the measured speed, not from the commanded one: another source may hold the vehicle back.
  const double from = std::clamp(speed_, input.speed - 0.5, input.speed + 0.5);
  speed_ = std::max(0.0, std::min(limit, from + options_.acceleration * dt));
  output->state = FollowerState::FOLLOWING;
  output->command.reason = rejoining ? "rejoining the path" : "following the path";
  output->command.speed = speed_;
  output->command.curvature = curvature_;
}

FollowerOutput PathFollower::update(const FollowerInput& input)
{
  FollowerOutput output;
  output.command.source = "navigation";
  const double dt = advanceClock(input.now_ns);
  const FollowerStop trouble = takePose(input);
  have_steered_ = false;
  if (path_.empty())
  {
    speed_ = 0.0;
    output.command.reason = "no path";
    return output;
  }
  if (trouble != FollowerStop::NONE)
  {
    return stopped(trouble, reasonOf(trouble, input), output);
  }
  output.pose = poseWhenCommandActs(input);
  const PathProjection projection = locate(output.pose);
  const double lateral_error = distanceTo(projection.s, output.pose);
  output.cross_track = projection.cross_track;
  output.distance_to_goal = path_.length() - projection.s;
  output.progress = projection.s / path_.length();
  // A vehicle at the goal may stand beside the end of the path, beyond max_offset.
  if (lateral_error > options_.max_offset && !done_)
  {
    located_ = false;
    return stopped(FollowerStop::OFF_PATH,
                   format("%.1f m off the path, must be within %.1f m: plan again", lateral_error, options_.max_offset),
                   output);
  }
  located_ = true;
  s_ = projection.s;
  if (reachedEnd(output.distance_to_goal))
  {
    return stopAtGoal(input.speed, output);
  }
  drive(input, projection, lateral_error, dt, &output);
  return output;
}

std::vector<Pose2> PathFollower::wayAhead(double length, double step) const
{
  std::vector<Pose2> way;
  if (!have_steered_ || path_.empty() || !(step > 0.0) || !std::isfinite(length))
  {
    return way;
  }
  Pose2 local;
  double s = located_ ? s_ : path_.project(steered_, HEADING_WEIGHT).s;
  s = path_.project(steered_, s - SEARCH_BACK, s + SEARCH_AHEAD).s;
  for (double done = 0.0; done <= length; done += step)
  {
    way.push_back(local);
    const Pose2 pose = steered_ * local;
    const PathProjection projection = path_.project(pose, s - 0.5, s + step + 0.5);
    s = projection.s;
    local = local.moved(step, pursuit(pose, s, projection.cross_track, speed_));
  }
  return way;
}

}  // namespace pi_vehicle
