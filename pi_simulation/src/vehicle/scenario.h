#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_simulation
{

/// What makes an actor go. With neither time nor place: it goes from the start.
struct ActorTrigger
{
  std::optional<double> time;           ///< since the start [s]
  std::optional<Eigen::Vector2d> near;  ///< the vehicle is within `within` of this point [m]
  double within = 0.0;                  ///< [m]
  bool command = false;                 ///< only by the command "actor ID go"
};

/// An actor rests at a place of its path.
struct ActorPause
{
  double at = 0.0;        ///< along the path [m]
  double duration = 0.0;  ///< [s]
};

struct ActorPlan
{
  std::string id;
  std::string class_name;                          ///< person, cart, car or box
  std::vector<Eigen::Vector2d> path;               ///< [m]; one point: it stands there
  double heading = 0.0;                            ///< where it stands [rad]; on a path: along it
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< box only [m]; 0: by the seed
  double speed = 1.2;                              ///< [m/s]
  double acceleration = 1.5;                       ///< [m/s^2]
  ActorTrigger trigger;
  std::vector<ActorPause> pauses;      ///< in order of `at`
  bool hidden = false;                 ///< until it goes
  std::optional<double> vanish_after;  ///< [s] since it went
  bool vanish_at_end = false;          ///< of its path
};

/// Words that somebody says; for the runner of a demo, the simulator only passes them on.
struct SpokenWords
{
  std::string clip;                     ///< name of a recording
  std::string text;                     ///< what is to be heard
  std::optional<double> time;           ///< since the start [s]
  std::optional<Eigen::Vector2d> near;  ///< or where [m]
  double within = 0.0;                  ///< [m]
  double delay = 0.0;                   ///< after that [s]
};

/// A computer beside the road; for the runner likewise.
struct EdgeNode
{
  std::string id;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
  double range = 0.0;                                  ///< [m]
};

/// A command of the simulator at a time.
struct PlannedFault
{
  double time = 0.0;      ///< since the start [s]
  double duration = 0.0;  ///< [s]; 0: until the end
  std::string begin;      ///< command line
  std::string end;        ///< after the duration; empty: none
};

/// A drive: world, start, goal, actors and what goes wrong. Coordinates are those of the world: of its road.
struct Scenario
{
  std::string name;
  uint64_t world_seed = 1;
  std::vector<Eigen::Vector2d> road;  ///< centre line [m]
  bool parked = true;                 ///< parked cars and boxes beside the road
  double bumps = 1.0;                 ///< scale of the road's unevenness
  double duration = 60.0;             ///< that it should take [s]; for the runner
  pi_vehicle::Pose2 start;            ///< of base_link
  pi_vehicle::Pose2 goal;
  std::vector<Eigen::Vector2d> waypoints;
  std::vector<ActorPlan> actors;
  std::vector<SpokenWords> spoken;
  std::vector<EdgeNode> edge_nodes;
  std::vector<PlannedFault> faults;

  /// Reads a YAML text. @param name  of the source, in messages. @param seed  decides within the ranges that it gives.
  /// @throws std::invalid_argument "<source>: <field> = <value>, must be <bound>"; a field that is unknown is refused
  /// with the list of the known ones.
  static Scenario parse(const std::string& yaml, const std::string& name, uint64_t seed);
  /// The same with a file.
  static Scenario load(const std::string& path, uint64_t seed);

  /// The scenario for other programs, in one line of JSON. @param T_map_world  coordinates are turned into this frame.
  std::string toJson(const pi_vehicle::Pose2& T_map_world) const;
};

}  // namespace pi_simulation
