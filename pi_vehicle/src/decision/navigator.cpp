#include "decision/navigator.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_vehicle
{

using pi_node::format;
using pi_node::seconds;

namespace
{

constexpr double STANDING_MPS = 0.05;    // [m/s]
constexpr double LEAST_MAX_SPEED = 0.1;  // of a goal [m/s]
constexpr double ARRIVAL_HEADING = 0.3;  // largest heading error of a vehicle that already stands at the goal [rad]
constexpr double AHEAD_STEP = 0.15;      // between poses of the way ahead [m]
constexpr double GROUND_AGE_S = 1.0;     // of the grid around the vehicle, at most
constexpr double LONGEST_STEP_S = 1.0;   // longest time step that counts for the distance [s]
constexpr double STAMP_AHEAD_S = 0.1;    // tolerated stamp in the future [s]
constexpr double DETOUR = 0.5;  // tolerated difference between a leg of the path and the straight leg, as a fraction
constexpr double JOINED = 0.2;  // the vehicle is on the loop within this distance [m] and heading error [rad]
constexpr double BESIDE_MARGIN = 0.2;  // kept from what the map's grid has [m]
constexpr double WIDE = 1.5;           // times that, and the vehicle's half width, where there is room
constexpr double START_FREE = 1.5;     // where the vehicle stands, whatever the grid says [m]
constexpr double REJOIN_AHEAD = 15.0;  // farthest place of a loop to join, ahead of the nearest one [m]

double legLength(const std::vector<Eigen::Vector2d>& points, bool loop)
{
  double length = loop && !points.empty() ? (points.front() - points.back()).norm() : 0.0;
  for (size_t i = 1; i < points.size(); ++i)
  {
    length += (points[i] - points[i - 1]).norm();
  }
  return length;
}

}  // namespace

void NavigatorOptions::validate() const
{
  route.validate();
  follower.validate();
  governor.validate();
  passing.validate();
  const pi_node::OptionCheck check("");
  check.range("max_position_deviation", max_position_deviation, 0.01, 100.0);
  check.range("vehicle_timeout_s", vehicle_timeout_s, 0.02, 60.0);
  check.range("blocked_after_s", blocked_after_s, 0.0, 86400.0);
  check.range("max_route_length", max_route_length, 1.0, 50000.0);
}

void NavigatorOptions::setVehicle(const pi_node::VehicleDescription& vehicle)
{
  route.min_radius = 1.0 / vehicle.limits.curvature;
  follower.limits = vehicle.limits;
  governor.limits = vehicle.limits;
  governor.footprint = vehicle.footprint;
}

Navigator::Navigator(const NavigatorOptions& options)
  : options_((options.validate(), options))
  , follower_(options.follower)
  , governor_(options.governor)
  , passing_(options.passing, options.governor.footprint, options.governor.limits)
{
}

std::string Navigator::check(const NavigationGoal& goal) const
{
  if (goal.waypoints.empty())
  {
    return "the goal has no place and no waypoint: give one or more";
  }
  for (size_t i = 0; i < goal.waypoints.size(); ++i)
  {
    const Waypoint& point = goal.waypoints[i];
    if (!point.position.allFinite() || (point.heading && !std::isfinite(*point.heading)))
    {
      return "point " + std::to_string(i + 1) + " of the goal has a number that is none: give finite numbers";
    }
  }
  if (!(goal.max_speed == 0.0 || (goal.max_speed >= LEAST_MAX_SPEED && std::isfinite(goal.max_speed))))
  {
    return format("max_speed = %g m/s, must be 0 (no bound) or at least %g", goal.max_speed, LEAST_MAX_SPEED);
  }
  return "";
}

Navigator::Plan Navigator::plan(const NavigationGoal& goal, const Pose2& pose, double speed) const
{
  Plan plan;
  RouteRequest request;
  request.loop = goal.loop;
  if (!goal.loop)
  {
    request.points.push_back(pose.position());
    request.start_heading = pose.heading;
    request.goal_heading = goal.waypoints.back().heading;
    const double turn = request.goal_heading ? wrapAngle(*request.goal_heading - pose.heading) : 0.0;
    plan.arrived = std::abs(speed) <= STANDING_MPS && std::abs(turn) <= ARRIVAL_HEADING &&
                   std::all_of(goal.waypoints.begin(), goal.waypoints.end(),
                               [&](const Waypoint& point) {
                                 return (point.position - pose.position()).norm() <= options_.follower.goal_tolerance;
                               });
    if (plan.arrived)
    {
      return plan;
    }
  }
  for (const Waypoint& point : goal.waypoints)
  {
    request.points.push_back(point.position);
  }
  if (const double length = legLength(request.points, goal.loop); !(length <= options_.max_route_length))
  {
    plan.problem = format("the route is %.0f m long, must be at most max_route_length = %.0f m", length,
                          options_.max_route_length);
    return plan;
  }
  RouteResult result = planRoute(request, options_.route);
  if (goal.find_way && map_ && (!result.path || firstOccupied(*result.path)))
  {
    plan.problem = goRound(&request);
    if (!plan.problem.empty())
    {
      return plan;
    }
    result = planRoute(request, options_.route);
    if (const auto occupied = result.path ? firstOccupied(*result.path) : std::nullopt)
    {
      plan.problem = format("the way to the goal leads over (%.1f,", occupied->x()) +
                     format(" %.1f), which is occupied on the map's grid: give waypoints", occupied->y());
      return plan;
    }
  }
  if (!result.path)
  {
    plan.problem = "no route: " + result.problem + (goal.loop ? "" : " (point 0 is where the vehicle stands)");
    return plan;
  }
  plan.path = *result.path;
  if (goal.loop)
  {
    const PathProjection projection = plan.path.project(pose, 1.0);
    if (std::abs(projection.cross_track) > options_.follower.rejoin_offset ||
        std::abs(projection.heading_error) > options_.follower.rejoin_heading)
    {
      result = rejoinRoute(plan.path, pose, REJOIN_AHEAD, options_.route);
      if (!result.path)
      {
        plan.problem = "no way to the loop: " + result.problem;
        return plan;
      }
      plan.loop = plan.path;
      plan.path = *result.path;
    }
  }
  return plan;
}

void Navigator::take(const Plan& plan)
{
  phase_ = Phase::DRIVING;
  arrived_ = plan.arrived;
  loop_ = plan.loop;
  follower_.setPath(plan.path);
  passing_.setRoute(plan.path);
  path_changed_ = true;
  findPoints();
}

std::optional<Eigen::Vector2d> Navigator::firstOccupied(const Path& path) const
{
  const double reach = options_.governor.footprint.half_width + BESIDE_MARGIN;
  for (double s = START_FREE; s <= path.length(); s += AHEAD_STEP)
  {
    for (double across = -reach; across <= reach; across += 0.5 * AHEAD_STEP)
    {
      const Eigen::Vector2d p = path.at(s).pose() * Eigen::Vector2d(0.0, across);
      if (map_->at(p) >= GroundGrid::OCCUPIED)
      {
        return p;
      }
    }
  }
  return std::nullopt;
}

std::string Navigator::goRound(RouteRequest* request) const
{
  const double radius = options_.governor.footprint.half_width + BESIDE_MARGIN;
  std::vector<Eigen::Vector2d> points{request->points.front()};
  for (size_t i = 1; i < request->points.size(); ++i)
  {
    const Eigen::Vector2d& to = request->points[i];
    auto corners = findWay(*map_, points.back(), to, WIDE * radius);
    corners = corners ? corners : findWay(*map_, points.back(), to, radius);
    if (!corners)
    {
      return format("the map's grid has no free way to the point (%.1f,", to.x()) +
             format(" %.1f) of the goal: is it on the grid, and free?", to.y());
    }
    points.insert(points.end(), corners->begin(), corners->end());
  }
  request->points = points;
  return "";
}

void Navigator::findPoints()
{
  point_s_.clear();
  passed_ = 0;
  if (path().empty() || goal_.loop)
  {
    return;
  }
  double s = 0.0;
  Eigen::Vector2d from = path().points().front().pose().position();
  for (size_t i = 0; i + 1 < goal_.waypoints.size(); ++i)
  {
    const Eigen::Vector2d& point = goal_.waypoints[i].position;
    const double leg = (point - from).norm();
    const double slack = DETOUR * leg + options_.route.corridor;
    s = path().project({point.x(), point.y(), 0.0}, std::max(s, s + leg - slack), s + leg + slack).s;
    point_s_.push_back(s);
    from = point;
  }
}

std::string Navigator::start(const NavigationGoal& goal, const NavigatorInput& input)
{
  std::string problem = check(goal);
  if (!problem.empty())
  {
    return problem;
  }
  std::string pose_problem;
  const std::optional<Pose2> pose = usablePose(input, &pose_problem);
  Plan planned;
  if (pose)
  {
    planned = plan(goal, *pose, input.speed);
    if (!planned.problem.empty())
    {
      return planned.problem;
    }
  }
  goal_ = goal;
  begin_ns_ = input.now_ns;
  free_ns_ = input.now_ns;
  distance_ = 0.0;
  take(planned);
  if (!pose)
  {
    phase_ = Phase::WAITING;
  }
  return "";
}

void Navigator::cancel(const std::string& reason)
{
  if (phase_ != Phase::IDLE)
  {
    phase_ = Phase::STOPPING;
    end_reason_ = reason;
  }
}

std::string Navigator::setObstacles(int64_t stamp_ns, const std::vector<ObstacleBox>& obstacles, int64_t now_ns)
{
  if (seconds(stamp_ns - now_ns) > STAMP_AHEAD_S)
  {
    return format("obstacles are stamped %.2f s ahead of this computer's clock and left out: synchronise the clocks",
                  seconds(stamp_ns - now_ns));
  }
  obstacles_heard_ = true;
  obstacles_ns_ = stamp_ns;
  return governor_.setObstacles(stamp_ns, obstacles)
             ? ""
             : "obstacles were left out: stamps must increase, positions, sizes and velocities must be finite";
}

bool Navigator::obstaclesSilent(int64_t now_ns) const
{
  return !obstacles_heard_ || seconds(now_ns - obstacles_ns_) > options_.governor.obstacles_timeout;
}

std::optional<Pose2> Navigator::usablePose(const NavigatorInput& input, std::string* problem) const
{
  if (!input.pose)
  {
    *problem = input.pose_problem.empty() ? "unknown" : input.pose_problem;
    return std::nullopt;
  }
  if (!input.pose->finite() || !std::isfinite(input.position_deviation))
  {
    *problem = "pose or covariance is not a number";
    return std::nullopt;
  }
  if (input.position_deviation > options_.max_position_deviation)
  {
    *problem = format("the position is known to %.1f m only, must be within max_position_deviation = %.1f m",
                      input.position_deviation, options_.max_position_deviation);
    return std::nullopt;
  }
  if (std::abs(seconds(input.now_ns - input.pose_stamp_ns)) > options_.follower.localisation_timeout)
  {
    *problem = format("the pose is older, or newer, than localisation_timeout = %.2f s",
                      options_.follower.localisation_timeout);
    return std::nullopt;
  }
  return input.pose;
}

std::string Navigator::vehicleProblem(const NavigatorInput& input) const
{
  if (input.vehicle_ns == 0)
  {
    return "nothing heard of it yet; is its driver started?";
  }
  if (seconds(input.now_ns - input.vehicle_ns) > options_.vehicle_timeout_s)
  {
    return format("nothing heard of it for %g s; does its driver run?", options_.vehicle_timeout_s);
  }
  return input.vehicle_problem;
}

void Navigator::keepBooks(const NavigatorInput& input)
{
  double dt = have_now_ ? seconds(input.now_ns - last_now_ns_) : 0.0;
  have_now_ = true;
  last_now_ns_ = input.now_ns;
  if (dt < 0.0)  // the clock went back
  {
    begin_ns_ = input.now_ns;
    free_ns_ = input.now_ns;
    obstacles_heard_ = false;
    dt = 0.0;
  }
  const bool known = std::isfinite(input.speed);
  if (phase_ != Phase::IDLE && known)
  {
    distance_ += std::abs(input.speed) * std::min(dt, LONGEST_STEP_S);
  }
}

GovernorOutput Navigator::govern(const NavigatorInput& input)
{
  if (!options_.need_obstacles && obstaclesSilent(input.now_ns))
  {
    // An empty report, as old as possible, so that the next real one is newer.
    governor_.setObstacles(input.now_ns - static_cast<int64_t>(0.9e9 * options_.governor.obstacles_timeout), {});
  }
  GovernorInput in;
  in.now_ns = input.now_ns;
  in.speed = input.speed;
  in.curvature = input.curvature;
  in.way = way_;
  return governor_.update(in);
}

void Navigator::finish(DriveEnd end, const std::string& reason, NavigatorOutput* output)
{
  output->end = end;
  output->state = NavigatorState::IDLE;
  output->command.speed = 0.0;
  output->command.reason = reason;
  follower_.clear();
  passing_.clear();
  loop_ = Path();
  path_changed_ = true;
  phase_ = Phase::IDLE;
}

void Navigator::changeToLoop(const FollowerOutput& followed)
{
  if (loop_.empty() || followed.state == FollowerState::STOPPED || followed.state == FollowerState::IDLE)
  {
    return;
  }
  const PathProjection projection = loop_.project(followed.pose, 1.0);
  const double offset = (loop_.at(projection.s).pose().position() - followed.pose.position()).norm();
  if (followed.state == FollowerState::DONE || (offset < JOINED && std::abs(projection.heading_error) < JOINED))
  {
    follower_.setPath(loop_);
    passing_.setRoute(loop_);
    loop_ = Path();
    path_changed_ = true;
  }
}

void Navigator::findLookAhead(const FollowerOutput& followed, double speed)
{
  look_ahead_.reset();
  if (followed.state == FollowerState::FOLLOWING && !way_.empty())
  {
    const PathFollowerOptions& o = options_.follower;
    const double distance = std::min(
        o.look_ahead_max, o.look_ahead_min + o.look_ahead_time * std::abs(speed) + std::abs(followed.cross_track));
    look_ahead_ = path().at(path().length() - followed.distance_to_goal + distance).pose().position();
  }
}

void Navigator::drive(const NavigatorInput& input, const FollowerOutput& followed, const GovernorOutput& governed,
                      const PassingOutput& passing, const std::string& pose_problem, NavigatorOutput* output)
{
  output->state = NavigatorState::DRIVING;
  DriveCommand& command = output->command;
  command = followed.command;
  output->limited_by = "path";
  if (goal_.max_speed > 0.0 && goal_.max_speed < command.speed)
  {
    command.speed = goal_.max_speed;
    command.reason += ", as fast as the goal allows";
    output->limited_by = "goal";
  }
  if (passing.speed_limit < command.speed)
  {
    command.speed = passing.speed_limit < options_.governor.min_speed ? 0.0 : passing.speed_limit;
    command.reason = passing.reason;
    command.max_deceleration = std::max(command.max_deceleration, options_.governor.limits.deceleration);
    output->limited_by = "obstacles";
    output->obstacle_id = passing.obstacle_id;
  }
  if (governed.speed_limit < command.speed)
  {
    command.speed = governed.speed_limit;
    command.max_deceleration = std::max(command.max_deceleration, governed.max_deceleration);
    command.reason = governed.reason.empty() ? command.reason : governed.reason;
    if (passing.obstacle_id == governed.obstacle_id && !passing.reason.empty())
    {
      command.reason += ": " + passing.reason;
    }
    output->limited_by = "obstacles";
    output->obstacle_id = governed.obstacle_id;
  }
  output->speed_limit = command.speed;

  const std::string vehicle = vehicleProblem(input);
  if (!vehicle.empty() || followed.state == FollowerState::STOPPED)
  {
    output->state = NavigatorState::STOPPED;
    output->limited_by.clear();
    output->obstacle_id = -1;
    command.speed = 0.0;
    command.max_deceleration = options_.follower.stop_deceleration;
    command.reason = !vehicle.empty() ? "vehicle: " + vehicle : followed.command.reason;
    if (vehicle.empty() && followed.stop == FollowerStop::NO_LOCALISATION)
    {
      command.reason += ": " + pose_problem;
    }
    else if (vehicle.empty() && followed.stop == FollowerStop::OFF_PATH)
    {
      command.reason += "; send the goal again";
    }
  }
  else if (governed.speed_limit <= 0.0 || (command.speed <= 0.0 && output->limited_by == "obstacles"))
  {
    output->state =
        options_.need_obstacles && obstaclesSilent(input.now_ns) ? NavigatorState::STOPPED : NavigatorState::HELD_UP;
  }
  if (governed.emergency)
  {
    command.max_deceleration = std::max(command.max_deceleration, governed.max_deceleration);
  }
}

FollowerOutput Navigator::follow(const NavigatorInput& input)
{
  FollowerInput follow;
  follow.now_ns = input.now_ns;
  follow.pose_stamp_ns = input.pose_stamp_ns;
  follow.pose = input.pose && input.position_deviation <= options_.max_position_deviation ? input.pose : std::nullopt;
  follow.speed = input.speed;
  follow.curvature = input.curvature;
  return follower_.update(follow);
}

std::string Navigator::planWaitingGoal(const std::optional<Pose2>& pose, double speed)
{
  if (phase_ != Phase::WAITING || !pose)
  {
    return "";
  }
  const Plan planned = plan(goal_, *pose, speed);
  if (planned.problem.empty())
  {
    take(planned);
  }
  return planned.problem;
}

void Navigator::driveOn(const NavigatorInput& input, const FollowerOutput& followed, const GovernorOutput& governed,
                        const PassingOutput& passing, const std::string& pose_problem, NavigatorOutput* output)
{
  changeToLoop(followed);
  if (arrived_ || (followed.state == FollowerState::DONE && !goal_.loop))
  {
    output->progress = 1.0;
    finish(DriveEnd::ARRIVED, "at the goal", output);
    return;
  }
  if (followed.stop == FollowerStop::GOAL_MISSED)
  {
    finish(DriveEnd::FAILED, followed.command.reason + "; send the goal again", output);
    return;
  }
  const double s = path().length() - followed.distance_to_goal;
  while (followed.state == FollowerState::FOLLOWING && passed_ < point_s_.size() && s > point_s_[passed_])
  {
    ++passed_;
  }
  drive(input, followed, governed, passing, pose_problem, output);
}

PassingOutput Navigator::pass(const NavigatorInput& input, const FollowerOutput& followed)
{
  if (phase_ != Phase::DRIVING || followed.state != FollowerState::FOLLOWING)
  {
    return {};
  }
  PassingInput in;
  in.now_ns = input.now_ns;
  const double age = std::max(0.0, seconds(input.now_ns - input.pose_stamp_ns));
  in.pose = input.pose->moved(input.speed * age, input.curvature);
  in.speed = input.speed;
  in.obstacles = governor_.obstacles();
  const bool fresh = ground_ && std::abs(seconds(input.now_ns - ground_->stamp_ns)) <= GROUND_AGE_S;
  in.ground = fresh ? &*ground_ : nullptr;
  PassingOutput output = passing_.update(in);
  if (output.path)
  {
    follower_.setPath(*output.path);
    path_changed_ = true;
    findPoints();
  }
  return output;
}

void Navigator::brakeToStandstill(const NavigatorInput& input, const FollowerOutput& followed,
                                  const GovernorOutput& governed, NavigatorOutput* output)
{
  output->state = NavigatorState::STOPPING;
  output->command.curvature = followed.state == FollowerState::IDLE ? curvature_ : followed.command.curvature;
  output->command.max_deceleration = governed.emergency ? governed.max_deceleration : 0.0;
  output->command.reason = end_reason_;
  if (!(std::abs(input.speed) > STANDING_MPS) || !vehicleProblem(input).empty())
  {
    finish(DriveEnd::CANCELLED, end_reason_, output);
  }
}

NavigatorOutput Navigator::update(const NavigatorInput& input)
{
  NavigatorOutput output;
  keepBooks(input);
  std::string pose_problem;
  const std::string plan_problem = planWaitingGoal(usablePose(input, &pose_problem), input.speed);
  const FollowerOutput followed = follow(input);
  way_ = follower_.wayAhead(options_.governor.horizon * options_.governor.limits.speed, AHEAD_STEP);
  const GovernorOutput governed = govern(input);
  const PassingOutput passing = pass(input, followed);
  findLookAhead(followed, input.speed);

  output.progress = followed.progress;
  output.distance_to_goal = followed.distance_to_goal;
  output.cross_track = followed.cross_track;
  output.time_to_collision = governed.time_to_collision;
  output.distance = distance_;
  output.duration_s = phase_ == Phase::IDLE ? 0.0 : seconds(input.now_ns - begin_ns_);
  output.command.curvature = curvature_;
  output.command.reason = "no goal";
  switch (phase_)
  {
    case Phase::IDLE:
      break;
    case Phase::WAITING:
      output.state = NavigatorState::WAITING;
      output.command.reason = "waits for a pose to plan from: " + pose_problem;
      if (!plan_problem.empty())
      {
        finish(DriveEnd::FAILED, plan_problem, &output);
      }
      break;
    case Phase::DRIVING:
      driveOn(input, followed, governed, passing, pose_problem, &output);
      break;
    case Phase::STOPPING:
      brakeToStandstill(input, followed, governed, &output);
      break;
  }
  giveUpIfBlocked(input, &output);
  if (phase_ == Phase::IDLE)
  {
    way_.clear();
    look_ahead_.reset();
  }
  curvature_ = output.command.curvature;
  output.command.source = "navigation";
  output.path_changed = std::exchange(path_changed_, false);
  return output;
}

void Navigator::giveUpIfBlocked(const NavigatorInput& input, NavigatorOutput* output)
{
  if (output->state != NavigatorState::HELD_UP || std::abs(input.speed) > STANDING_MPS)
  {
    free_ns_ = input.now_ns;
  }
  else if (options_.blocked_after_s > 0.0 && seconds(input.now_ns - free_ns_) >= options_.blocked_after_s)
  {
    const Pose2 pose = input.pose.value_or(Pose2());
    finish(DriveEnd::FAILED,
           format("blocked at (%.1f,", pose.x) + format(" %.1f)", pose.y) +
               format(" for %g s: ", options_.blocked_after_s) + output->command.reason,
           output);
  }
}

const char* toString(NavigatorState state)
{
  static constexpr const char* NAMES[] = {"idle", "waiting", "driving", "held up", "stopped", "stopping"};
  return NAMES[static_cast<size_t>(state)];
}

}  // namespace pi_vehicle
