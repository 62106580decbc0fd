#pragma once

#include "decision/drive_command.h"
#include "decision/ground_grid.h"
#include "decision/passing.h"
#include "decision/path_follower.h"
#include "decision/route.h"
#include "decision/speed_governor.h"

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

struct NavigatorOptions
{
  RouteOptions route;
  PathFollowerOptions follower;
  SpeedGovernorOptions governor;
  PassingOptions passing;
  bool need_obstacles = true;           ///< false: drives without reports of obstacles; heeds them where they come
  double max_position_deviation = 1.0;  ///< one sigma of the position beyond which localisation is lost [m]
  double vehicle_timeout_s = 0.5;       ///< silence of the vehicle after which it stops [s]
  double blocked_after_s = 30.0;        ///< a goal whose way is blocked for so long is given up; 0: never [s]
  double max_route_length = 2000.0;     ///< of the straight legs [m]

  /// Its outline, its limits, its turning circle.
  void setVehicle(const pi_node::VehicleDescription& vehicle);
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A point to drive over, in the map.
struct Waypoint
{
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
  std::optional<double> heading;                       ///< of the last one only, to arrive with [rad]
};

struct NavigationGoal
{
  std::vector<Waypoint> waypoints;
  double max_speed = 0.0;  ///< [m/s]; 0: none
  bool loop = false;       ///< round and round
  bool find_way = false;   ///< where the straight line is not free on the map's grid, round what stands there
};

struct NavigatorInput
{
  int64_t now_ns = 0;
  int64_t pose_stamp_ns = 0;        ///< on the clock of now_ns
  std::optional<Pose2> pose;        ///< T_map_base at pose_stamp_ns
  double position_deviation = 0.0;  ///< of the pose, one sigma; 0: unknown [m]
  std::string pose_problem;         ///< why there is no pose

  int64_t vehicle_ns = 0;       ///< when speed and curvature were heard; before the first: 0
  double speed = 0.0;           ///< measured [m/s]
  double curvature = 0.0;       ///< measured [1/m]
  std::string vehicle_problem;  ///< why it will not drive; empty: it will
};

enum class NavigatorState
{
  IDLE,     ///< no goal
  WAITING,  ///< a goal, but no pose yet to plan from
  DRIVING,  ///< on the way
  HELD_UP,  ///< on the way, but an obstacle makes it stop or wait
  STOPPED,  ///< on the way, but in trouble: localisation, vehicle, obstacles silent, off the path
  STOPPING  ///< slows down to a standstill after the goal was cancelled
};

enum class DriveEnd
{
  NONE,
  ARRIVED,
  FAILED,
  CANCELLED
};

struct NavigatorOutput
{
  NavigatorState state = NavigatorState::IDLE;
  DriveEnd end = DriveEnd::NONE;  ///< the goal ended in this update; the reason says how
  DriveCommand command;           ///< source "navigation"
  double progress = 0.0;          ///< in [0, 1]
  double distance_to_goal = 0.0;  ///< along the path [m]
  double cross_track = 0.0;       ///< left of the path positive [m]
  double speed_limit = 0.0;       ///< the least of all bounds [m/s]
  std::string limited_by;         ///< "path", "goal", "obstacles", or "" where nothing drives
  int64_t obstacle_id = -1;       ///< that sets the limit; -1: none
  double time_to_collision = std::numeric_limits<double>::infinity();  ///< [s]
  double distance = 0.0;                                               ///< driven for this goal [m]
  double duration_s = 0.0;                                             ///< since the goal began [s]
  bool path_changed = false;                                           ///< path() is another since the last update
};

/// From a goal to a motion: plans the route, follows it, keeps the speed below what obstacles allow, and stops on
/// trouble. All trouble but an error of the route is waited for: the vehicle goes on when it is over.
/// Never plans again by itself: who gets lost far from the path, or missed the goal, needs a new goal.
/// Not thread safe; time comes in as numbers only.
class Navigator
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit Navigator(const NavigatorOptions& options = NavigatorOptions());

  /// Drives to a new goal, which replaces the present one. Without a pose the route is planned when the first one
  /// comes.
  /// @return empty if accepted; else the problem with its remedy, and nothing changes.
  std::string start(const NavigationGoal& goal, const NavigatorInput& input);
  /// Brakes to a standstill on the path. @param reason  for people.
  void cancel(const std::string& reason);
  bool active() const { return phase_ != Phase::IDLE; }

  /// As SpeedGovernor::setObstacles(). @return what was left out, with the remedy; empty: nothing.
  std::string setObstacles(int64_t stamp_ns, const std::vector<ObstacleBox>& obstacles, int64_t now_ns);

  /// The ground around the vehicle as it was seen last, for ways round obstacles.
  void setGround(const GroundGrid& grid) { ground_ = grid; }
  /// The grid of the whole map, for goals with find_way.
  void setMap(const GroundGrid& grid) { map_ = grid; }

  /// Call at 10 to 100 Hz.
  NavigatorOutput update(const NavigatorInput& input);

  /// Valid while active().
  const NavigationGoal& goal() const { return goal_; }
  /// Number of the goal's points that were passed. The last point, and those of a loop, never count.
  size_t passed() const { return passed_; }
  /// The path that is driven; empty: none.
  const Path& path() const { return follower_.path(); }
  /// The way ahead, in base_link at the last update.
  const std::vector<Pose2>& wayAhead() const { return way_; }
  /// The point that the vehicle steers to, in the map; for display.
  std::optional<Eigen::Vector2d> lookAhead() const { return look_ahead_; }

private:
  enum class Phase
  {
    IDLE,
    WAITING,
    DRIVING,
    STOPPING
  };
  struct Plan
  {
    Path path;
    Path loop;  ///< that the path leads to; empty: none
    bool arrived = false;
    std::string problem;
  };

  /// @return what is wrong with the goal alone, without a pose; empty: nothing.
  std::string check(const NavigationGoal& goal) const;
  Plan plan(const NavigationGoal& goal, const Pose2& pose, double speed) const;
  /// Puts the corners of a free way over the map's grid between the points.
  /// @return the problem with its remedy; empty: none.
  std::string goRound(RouteRequest* request) const;
  std::optional<Eigen::Vector2d> firstOccupied(const Path& path) const;
  void take(const Plan& plan);
  void finish(DriveEnd end, const std::string& reason, NavigatorOutput* output);
  std::optional<Pose2> usablePose(const NavigatorInput& input, std::string* problem) const;
  std::string vehicleProblem(const NavigatorInput& input) const;
  void keepBooks(const NavigatorInput& input);
  bool obstaclesSilent(int64_t now_ns) const;
  GovernorOutput govern(const NavigatorInput& input);
  void drive(const NavigatorInput& input, const FollowerOutput& followed, const GovernorOutput& governed,
             const PassingOutput& passing, const std::string& pose_problem, NavigatorOutput* output);
  FollowerOutput follow(const NavigatorInput& input);
  /// @return why there is no plan; empty: planned, or nothing to plan yet.
  std::string planWaitingGoal(const std::optional<Pose2>& pose, double speed);
  void driveOn(const NavigatorInput& input, const FollowerOutput& followed, const GovernorOutput& governed,
               const PassingOutput& passing, const std::string& pose_problem, NavigatorOutput* output);
  void brakeToStandstill(const NavigatorInput& input, const FollowerOutput& followed, const GovernorOutput& governed,
                         NavigatorOutput* output);
  PassingOutput pass(const NavigatorInput& input, const FollowerOutput& followed);
  void giveUpIfBlocked(const NavigatorInput& input, NavigatorOutput* output);
  void changeToLoop(const FollowerOutput& followed);
  void findPoints();
  void findLookAhead(const FollowerOutput& followed, double speed);

  const NavigatorOptions options_;
  PathFollower follower_;
  SpeedGovernor governor_;
  Passing passing_;
  std::optional<GroundGrid> ground_;
  std::optional<GroundGrid> map_;
  Phase phase_ = Phase::IDLE;
  NavigationGoal goal_;
  bool arrived_ = false;  ///< stood at the goal when it came
  Path loop_;             ///< is driven after the way to it
  bool path_changed_ = false;
  std::vector<double> point_s_;  ///< of the goal's points but the last, along the path [m]
  size_t passed_ = 0;
  std::string end_reason_;  ///< STOPPING: of the cancel
  double curvature_ = 0.0;  ///< commanded last

  bool obstacles_heard_ = false;
  int64_t obstacles_ns_ = 0;  ///< stamp of the last report

  bool have_now_ = false;
  int64_t last_now_ns_ = 0;
  int64_t begin_ns_ = 0;
  int64_t free_ns_ = 0;  ///< when it was not held up, or moved, last
  double distance_ = 0.0;
  std::vector<Pose2> way_;
  std::optional<Eigen::Vector2d> look_ahead_;
};

/// "idle", "waiting", "driving", "held up", "stopped", "stopping".
const char* toString(NavigatorState state);

}  // namespace pi_vehicle
