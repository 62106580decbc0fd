#pragma once

#include "decision/drive_command.h"
#include "decision/path.h"

#include <pi_node/vehicle_description.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

struct PathFollowerOptions
{
  pi_node::MotionLimits limits;           ///< of the vehicle
  double acceleration = 0.8;              ///< [m/s^2]
  double deceleration = 0.8;              ///< planned, before corners and the goal; below the usual 1.0 [m/s^2]
  double stop_deceleration = 1.5;         ///< when the follower must stop [m/s^2]
  double max_lateral_acceleration = 1.2;  ///< limits the speed in bends [m/s^2]
  double look_ahead_min = 0.8;            ///< [m]
  double look_ahead_time = 0.45;          ///< look-ahead = min + time * speed + |cross-track error| [s]
  double look_ahead_max = 4.0;            ///< [m]
  double actuation_delay = 0.15;          ///< of steering and drive; the pose is predicted over it [s]
  double rejoin_speed = 1.0;              ///< limit while off or across the path [m/s]
  double rejoin_offset = 0.5;             ///< lateral error from which the vehicle counts as off the path [m]
  double rejoin_heading = 0.6;            ///< heading error from which it counts as across the path [rad]
  double max_offset = 4.0;                ///< beyond it the follower stops [m]
  double goal_tolerance = 0.5;            ///< largest distance from the goal at standstill [m]
  double localisation_timeout = 0.3;      ///< oldest pose to steer by [s]
  double jump_small = 0.1;  ///< between a pose and its prediction from speed and curvature; smaller is noise [m]
  double jump_large = 1.0;  ///< a jump this large stops the vehicle [m]
  double jump_large_heading = 0.35;  ///< likewise [rad]
  double jump_blend_time = 1.0;      ///< time constant with which a small jump is blended in [s]
  double jump_settle_time = 2.0;  ///< poses must agree for this time after a large jump; 0: only resume() continues [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.look_ahead_min, o.jump_settle_time, void())
{
  visit("acceleration", o.acceleration);
  visit("deceleration", o.deceleration);
  visit("stop_deceleration", o.stop_deceleration);
  visit("max_lateral_acceleration", o.max_lateral_acceleration);
  visit("look_ahead_min", o.look_ahead_min);
  visit("look_ahead_time", o.look_ahead_time);
  visit("look_ahead_max", o.look_ahead_max);
  visit("actuation_delay", o.actuation_delay);
  visit("rejoin_speed", o.rejoin_speed);
  visit("rejoin_offset", o.rejoin_offset);
  visit("rejoin_heading", o.rejoin_heading);
  visit("max_offset", o.max_offset);
  visit("goal_tolerance", o.goal_tolerance);
  visit("localisation_timeout", o.localisation_timeout);
  visit("jump_small", o.jump_small);
  visit("jump_large", o.jump_large);
  visit("jump_large_heading", o.jump_large_heading);
  visit("jump_blend_time", o.jump_blend_time);
  visit("jump_settle_time", o.jump_settle_time);
}

enum class FollowerState
{
  IDLE,       ///< no path
  FOLLOWING,  ///< on the way
  STOPPED,    ///< on the way, but held up: see `stop`
  DONE        ///< at the goal, standing
};

enum class FollowerStop
{
  NONE,
  NO_LOCALISATION,      ///< none yet, or reported lost
  STALE_LOCALISATION,   ///< older than localisation_timeout, or from the future
  LOCALISATION_JUMPED,  ///< by jump_large or more
  OFF_PATH,             ///< farther than max_offset
  BAD_INPUT,            ///< a number that is not finite
  GOAL_MISSED           ///< at the end of the path, but farther than goal_tolerance from the goal
};

struct FollowerInput
{
  int64_t now_ns = 0;
  int64_t pose_stamp_ns = 0;  ///< of the newest pose, on the clock of now_ns
  std::optional<Pose2> pose;  ///< T_map_base at pose_stamp_ns; nullopt: localisation is lost
  double speed = 0.0;         ///< measured [m/s]
  double curvature = 0.0;     ///< measured [1/m]
};

struct FollowerOutput
{
  FollowerState state = FollowerState::IDLE;
  FollowerStop stop = FollowerStop::NONE;
  DriveCommand command;           ///< source "navigation"; speed 0 except in FOLLOWING
  double progress = 0.0;          ///< done part of the path, in [0, 1]; closed: of this round
  double distance_to_goal = 0.0;  ///< along the path [m]; closed: to the start of the next round
  double cross_track = 0.0;       ///< left of the path positive [m]
  Pose2 pose;                     ///< T_map_base at the time the command takes effect
};

/// Follows a path forwards by pure pursuit (Coulter 1992) with a look-ahead that grows with speed and error.
///
/// Why pure pursuit and not Stanley: its output is a curvature, so one controller serves car-like and differential
/// vehicles without a wheelbase. It works down to standstill, where Stanley divides by the speed. The look-ahead damps
/// noise of the pose and lag of the steering. Pure pursuit cuts corners; two measures limit that: the speed, and with
/// it the look-ahead, is low where the path bends, and the vehicle steers from the pose predicted for the time at which
/// the command takes effect.
///
/// The speed is the largest one that keeps the lateral acceleration and lets the vehicle stop at the goal.
/// Not thread safe.
class PathFollower
{
public:
  /// @throws std::invalid_argument from validate().
  explicit PathFollower(const PathFollowerOptions& options = PathFollowerOptions());

  /// @param path  in the map; the vehicle must be within max_offset of it. Empty: as clear().
  void setPath(const Path& path);
  void clear();
  /// After a large jump: continues from the new pose.
  void resume();

  /// Call at 10 to 100 Hz. After a clock that goes back, the next pose is the first one.
  FollowerOutput update(const FollowerInput& input);

  /// The way ahead for SpeedGovernor, in base_link at the last update: arcs of pure pursuit to the path, then the path.
  /// @param length  [m]. @param step  between poses [m]. @return empty without a path or a pose.
  std::vector<Pose2> wayAhead(double length, double step) const;

  const Path& path() const { return path_; }

private:
  FollowerOutput stopped(FollowerStop stop, const std::string& reason, FollowerOutput output);
  /// @return the time since the last update, bounded [s].
  double advanceClock(int64_t now_ns);
  FollowerStop takePose(const FollowerInput& input);
  /// Tells small jumps of the pose, which are blended in, from large ones, which stop the vehicle.
  void compareWithPrediction(const FollowerInput& input);
  std::string reasonOf(FollowerStop trouble, const FollowerInput& input) const;
  Pose2 poseWhenCommandActs(const FollowerInput& input);
  PathProjection locate(const Pose2& pose) const;
  double distanceTo(double s, const Pose2& pose) const;
  bool reachedEnd(double distance_to_goal) const;
  FollowerOutput stopAtGoal(double measured_speed, FollowerOutput output);
  void drive(const FollowerInput& input, const PathProjection& projection, double lateral_error, double dt,
             FollowerOutput* output);
  double pursuit(const Pose2& pose, double s, double cross_track, double speed) const;
  double plannedSpeed(double s, double speed) const;

  const PathFollowerOptions options_;
  Path path_;
  bool located_ = false;  // on the path: s_ is valid
  double s_ = 0.0;
  bool done_ = false;
  bool missed_ = false;
  double curvature_ = 0.0;  // commanded
  double speed_ = 0.0;      // commanded

  bool have_pose_ = false;
  int64_t pose_stamp_ns_ = 0;
  Pose2 raw_pose_;       // newest
  Pose2 offset_;         // rest of a small jump that is not blended in yet, in the map
  bool jumped_ = false;  // stopped by a large jump
  int64_t settled_since_ns_ = 0;
  int64_t last_now_ns_ = 0;
  bool have_now_ = false;
  Pose2 steered_;
  bool have_steered_ = false;
};

}  // namespace pi_vehicle
