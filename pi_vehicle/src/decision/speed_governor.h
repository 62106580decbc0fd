#pragma once

#include "decision/hidden_people.h"

#include <pi_node/vehicle_description.h>
#include <pi_vehicle/decision/ground_polygon.h>
#include <pi_vehicle/decision/pose2.h>

#include <cstdint>
#include <deque>
#include <limits>
#include <string>
#include <vector>

namespace pi_vehicle
{

struct SpeedGovernorOptions
{
  pi_node::Footprint footprint;    ///< of the vehicle
  pi_node::MotionLimits limits;    ///< of the vehicle: speed, usual and emergency deceleration count
  double reaction_time = 0.35;     ///< from an obstacle report until the brakes act, period of update() included [s]
  double margin = 0.3;             ///< kept free on the sides and ahead [m]
  double stop_gap = 0.7;           ///< kept free ahead when stopping, on top of the margin [m]
  double headway = 0.4;            ///< time gap to a moving obstacle, on top of stop_gap [s]
  double min_moving_speed = 0.15;  ///< slower obstacles count as standing [m/s]
  double horizon = 4.5;            ///< prediction time [s]
  double pass_time_margin = 0.7;   ///< time between the vehicle and a moving obstacle that passes the same place [s]
  double close_speed = 0.6;        ///< limit while an obstacle is inside the margin [m/s]
  double memory = 0.8;             ///< an obstacle stays known for this time after its last report [s]
  double clear_persistence = 1.0;  ///< after a stop the way must be clear for this time [s]
  double resume_speed = 0.5;       ///< the way is clear if at least this speed is allowed [m/s]
  double min_speed = 0.15;         ///< a lower limit becomes a stop [m/s]
  double rise = 1.0;               ///< fastest rise of the limit [m/s^2]
  double obstacles_timeout = 0.5;  ///< the vehicle stops after this time without a report [s]
  double step_out_speed = 2.0;     ///< of adults who may come from behind what hides them; 0: none do [m/s]
  double child_speed = 1.4;        ///< likewise of children, whom lower things hide [m/s]
  double step_out_reaction_time = 0.6;  ///< from where they can be seen until the brakes act [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.pass_time_margin, o.clear_persistence, void())
{
  visit("reaction_time", o.reaction_time);
  visit("margin", o.margin);
  visit("stop_gap", o.stop_gap);
  visit("headway", o.headway);
  visit("min_moving_speed", o.min_moving_speed);
  visit("horizon", o.horizon);
  visit("pass_time_margin", o.pass_time_margin);
  visit("close_speed", o.close_speed);
  visit("memory", o.memory);
  visit("clear_persistence", o.clear_persistence);
  visit("resume_speed", o.resume_speed);
  visit("min_speed", o.min_speed);
  visit("rise", o.rise);
  visit("obstacles_timeout", o.obstacles_timeout);
  visit("step_out_speed", o.step_out_speed);
  visit("child_speed", o.child_speed);
  visit("step_out_reaction_time", o.step_out_reaction_time);
}

/// A pi_detect/Obstacle3D on the ground plane.
struct ObstacleBox
{
  int64_t id = 0;                                               ///< the same in all reports of one obstacle
  Eigen::Vector2d position = Eigen::Vector2d::Zero();           ///< centre, in base_link at the stamp [m]
  Eigen::Vector2d size = Eigen::Vector2d::Zero();               ///< along the axes of base_link [m]
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();           ///< over the ground, in the axes of base_link [m/s]
  std::string label;                                            ///< class; empty: unknown
  double top = 0.0;                                             ///< height of its upper end above the ground [m]
  bool moving = true;                                           ///< false: counts as standing, whatever its velocity
  double followed_s = std::numeric_limits<double>::infinity();  ///< from where it was seen first to where last [s]
  double unseen_s = 0.0;                                        ///< since it was seen last [s]
  /// Its outline, valid by GroundPolygon::isOutline(), in base_link at the stamp [m]; empty: the box counts.
  std::vector<Eigen::Vector2d> outline;
};

/// An obstacle as the governor knows it, in base_link.
struct KnownObstacle
{
  int64_t id = 0;
  GroundPolygon outline;
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  ///< over the ground; 0 unless `moving` [m/s]
  bool moving = false;
  double standing_s = 0.0;  ///< for so long it was seen not to move [s]
  double top = 0.0;         ///< height of its upper end above the ground [m]
  std::string label;        ///< class; empty: unknown
};

struct GovernorInput
{
  int64_t now_ns = 0;
  double speed = 0.0;      ///< measured [m/s]
  double curvature = 0.0;  ///< measured [1/m]
  std::vector<Pose2> way;  ///< poses that the vehicle will take, in base_link, the first about (0, 0, 0), spaced by
                           ///< 0.05 to 0.3 m; as PathFollower::wayAhead(). Empty: the arc of `curvature`.
};

struct GovernorOutput
{
  double speed_limit = 0.0;       ///< of the speed along the way [m/s]
  double max_deceleration = 0.0;  ///< to brake with [m/s^2]
  bool emergency = false;         ///< comfortable braking would end in contact: speed_limit is 0
  int64_t obstacle_id = -1;       ///< the obstacle that sets the limit; -1: none
  double time_to_collision = std::numeric_limits<double>::infinity();  ///< at the present speed [s]
  std::string reason;                                                  ///< for people; empty: nothing limits
};

/// Limits the speed along the way ahead so that the vehicle hits nothing.
///
/// Obstacles move with constant velocity from their stamp on, as outlines or, without one, as boxes. The vehicle's
/// outline with margin moves along the way. A speed is allowed if
/// - driving it for the reaction time and then braking comfortably touches no obstacle, with a gap ahead that grows
///   with the speed. So the vehicle stops before standing obstacles, follows slower ones, lets crossing ones pass and
///   waits for oncoming ones; and
/// - emergency braking suffices if a moving obstacle stops at once; and
/// - a person who comes from behind a standing obstacle is not hit: see hidden_people.h. What appears there is taken
///   for one, walking onto the way, until it has been followed for long enough to know its velocity.
/// If the present speed is not allowed, the vehicle keeps it where it passes all obstacles with pass_time_margin. An
/// emergency is when comfortable braking would end in contact. For what moves or may hide a person, braking is the
/// harder the more the speed is above the limit. Obstacles that are wholly behind the vehicle do not count, as it only
/// drives forwards.
///
/// Dead reckoning with measured speed and curvature makes up for the latency of the reports. Not thread safe.
class SpeedGovernor
{
public:
  /// @throws std::invalid_argument from validate().
  explicit SpeedGovernor(const SpeedGovernorOptions& options = SpeedGovernorOptions());

  /// Takes a report of all obstacles known at the stamp; it may be empty. Boxes with numbers that are not finite,
  /// invalid outlines (the box then counts) and reports that are not newer than the last are left out and counted. A
  /// stamp more than 1 s back resets the governor.
  /// @return false if the report, or a part of it, was left out.
  bool setObstacles(int64_t stamp_ns, const std::vector<ObstacleBox>& obstacles);

  /// Call at 10 to 50 Hz. A clock that goes back resets the governor: the limit is 0 until the next report.
  GovernorOutput update(const GovernorInput& input);

  /// All obstacles that are known, where they are at the time of the last update().
  std::vector<KnownObstacle> obstacles() const;

private:
  struct Known  // in the frame of dead reckoning
  {
    int64_t id;
    int64_t seen_ns;
    GroundPolygon outline;
    Eigen::Vector2d velocity;
    bool moving;
    hidden_people::Who hidden;  // can stand behind it unseen
    GroundPolygon hiding;       // its outline when it was seen well
    std::string label;
    double top;
    int64_t standing_since_ns;
    double followed_s;
    double unseen_s;
    int64_t out_of;  // the obstacle that it came out from behind, if it may be a person who did, ...
    double walks;    // ... and how fast they are taken to walk [m/s]
  };
  struct Placed  // a pose of the vehicle
  {
    Eigen::Vector2d position;
    Eigen::Vector2d along;  // unit vector
  };
  struct Local  // in base_link now
  {
    int64_t id;
    GroundPolygon outline;
    Eigen::Vector2d velocity;
    bool moving;
    hidden_people::Who hidden;
    GroundPolygon hiding;
    double margin;
    int64_t out_of = -1;  // the obstacle that it came out from behind, if it is to be taken for a person who did
  };
  struct Bound  // of the speed, by all obstacles
  {
    double speed;
    bool by_moving = false;  // the obstacle that sets the bound moves
    bool by_hidden = false;  // by a person who may be behind the obstacle
    int64_t out_of = -1;     // by a person who may have come out from behind this one
    int64_t obstacle_id = -1;
    bool emergency = false;
    double time_to_collision = std::numeric_limits<double>::infinity();
  };

  Pose2 poseAt(int64_t stamp_ns) const;
  bool touches(const Local& obstacle, double at_s, const Placed& vehicle, double extra_front, double margin) const;
  Placed alongWay(double s) const;
  /// Places along the way every TIME_STEP, from braking at a multiple of SPEED_STEP until STANDING_S after the stop.
  const std::vector<Placed>& brakingPlaces(size_t speed_steps, bool emergency);
  std::vector<Placed> makeBrakingPlaces(double speed, double deceleration) const;
  bool brakes(const Local& obstacle, const std::vector<Placed>& places, double standing_s, double gap, double margin,
              bool frozen) const;
  bool isFar(const Local& obstacle) const;
  bool passes(const Local& obstacle) const;
  double timeToCollision(const Local& obstacle) const;
  /// Distance to keep ahead when following or stopping, beyond the margin [m].
  double timeGap(const Local& obstacle, double speed) const;
  double leastMargin(const Local& obstacle) const;
  /// Whether comfortable braking keeps the gap, and emergency braking suffices if a moving obstacle stops dead.
  bool stopsInTime(const Local& obstacle, size_t speed_steps);
  /// The largest speed, at most `bound`, below which stopsInTime() holds for every speed.
  double stoppableSpeed(const Local& obstacle, double bound);
  /// @return time since the last update; 0 after a clock that jumped [s].
  double deadReckon(const GovernorInput& input);
  void forgetUnseen(int64_t now_ns);
  bool isMoving(const Known& known) const;
  static bool canBePerson(const Known& known);
  /// Finds what has just come out from behind something and may be a person.
  void findNewcomers();
  /// Lets such a person walk onto the way, until it is known how it moves.
  void letWalk(const Known& known, int64_t now_ns, Local* local) const;
  /// Who was seen setting out towards the way and left the view may be faster by now.
  void letRun(const Known& known, Local* local) const;
  /// Velocity over the ground in base_link now; 0 of what stands.
  Eigen::Vector2d velocityOf(const Known& known, const Pose2& T_base_reckoned) const;
  GroundPolygon outlineNow(const Known& known, const Pose2& T_base_reckoned, int64_t now_ns) const;
  std::vector<Local> nearTheWay(int64_t now_ns) const;
  Bound boundBy(const std::vector<Local>& obstacles, double speed);
  bool mayResume(const Bound& bound, double speed, int64_t now_ns, std::string* reason);
  GovernorOutput stop(const std::string& reason, GovernorOutput output);
  void setWay(const GovernorInput& input);
  double clearance(const Local& obstacle) const;
  /// The largest speed for which nobody from behind the obstacle is hit.
  double speedBeside(const Local& obstacle) const;
  void reset();

  const SpeedGovernorOptions options_;
  std::vector<Known> known_;
  std::deque<std::pair<int64_t, Pose2>> track_;  // dead reckoning of the last seconds
  std::vector<Pose2> way_;
  std::vector<double> way_s_;
  std::vector<Placed> at_speed_;                  // along the way at the present speed, every TIME_STEP
  std::vector<Placed> reach_;                     // along the whole way that is looked at
  std::vector<std::vector<Placed>> comfortable_;  // brakingPlaces(), computed when first asked for
  std::vector<std::vector<Placed>> emergency_;
  bool reported_ = false;
  int64_t report_ns_ = 0;
  int64_t last_ns_ = 0;
  double limit_ = 0.0;
  bool standing_ = false;  // held at 0 until clear for clear_persistence
  bool was_clear_ = false;
  int64_t clear_since_ns_ = 0;
};

}  // namespace pi_vehicle
