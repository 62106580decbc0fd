#pragma once

#include "renderer/stereo_renderer.h"

#include <pi_vehicle/decision/pose2.h>

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_simulation
{

/// Starts an actor. With time and place, both must hold: from the time on, when the vehicle is there. Without time,
/// place and command the actor moves from the start.
struct ActorTrigger
{
  std::optional<double> time;           ///< since the start [s]
  std::optional<Eigen::Vector2d> near;  ///< the vehicle is within `within` of this point [m]
  double within = 0.0;                  ///< [m]
  bool command = false;                 ///< only by the command "actor ID go"
};

/// A rest of an actor on its path.
struct ActorPause
{
  double at = 0.0;        ///< along the path [m]
  double duration = 0.0;  ///< [s]
};

struct ActorPlan
{
  std::string id;
  std::string class_name;                          ///< as in ActorOptions
  std::vector<Eigen::Vector2d> path;               ///< [m]; one point: it stands there
  double heading = 0.0;                            ///< where it stands [rad]; on a path: along it
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< as in ActorOptions [m]
  double speed = 1.2;                              ///< [m/s]
  double acceleration = 1.5;                       ///< [m/s^2]
  ActorTrigger trigger;
  std::vector<ActorPause> pauses;      ///< in order of `at`
  bool hidden = false;                 ///< until it goes
  std::optional<double> vanish_after;  ///< [s] since it went
  bool vanish_at_end = false;          ///< of its path
};

/// Spoken words. The simulator only passes them on to the runner of a demo.
struct SpokenWords
{
  std::string clip;                     ///< name of a recording
  std::string text;                     ///< the words
  std::optional<double> time;           ///< since the start [s]
  std::optional<Eigen::Vector2d> near;  ///< or at this place [m]
  double within = 0.0;                  ///< [m]
  double delay = 0.0;                   ///< after time or place [s]
};

/// A computer beside the road, for the runner of a demo.
struct EdgeNode
{
  std::string id;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
  double range = 0.0;                                  ///< [m]
};

/// A command of the simulator at a time, at a place, or from a time on at a place; once.
struct PlannedFault
{
  double time = 0.0;                    ///< since the start [s]
  std::optional<Eigen::Vector2d> near;  ///< the vehicle is within `within` of this point [m]
  double within = 0.0;                  ///< [m]
  double duration = 0.0;                ///< [s]; 0: at a place until the vehicle leaves it, else for good
  std::string begin;                    ///< command line
  std::string end;                      ///< command line afterwards; empty: none
};

/// Whether the runner of a drive executes a fault's command, as the simulator has no part in it: `kill NODE` (of the
/// graph) and `radio on|off` (to the edge nodes).
bool isForRunner(const std::string& command);

/// A drive: world, start, goal, actors and faults. Coordinates are those of the world, and so of its road.
struct Scenario
{
  std::string name;
  uint64_t world_seed = 1;
  std::vector<Eigen::Vector2d> road;  ///< centre line [m]
  bool parked = true;                 ///< parked cars and boxes beside the road
  double bumps = 1.0;                 ///< scale of the road's unevenness
  double duration = 60.0;             ///< expected [s]; for the runner of a demo
  pi_vehicle::Pose2 start;            ///< of base_link
  pi_vehicle::Pose2 goal;
  std::vector<pi_vehicle::Pose2> further_goals;  ///< one after the other, when the goal before is reached
  std::vector<Eigen::Vector2d> waypoints;        ///< on the way to `goal`
  std::string expect = "reach";                  ///< reach (all goals), refuse (not to set off) or stop (before a goal)
  std::string reason;                            ///< to refuse: part of what the vehicle says why
  double light = 1.0;                            ///< of the day: 0.25 dusk, 0.08 night
  double picture_noise = 1.0;                    ///< scale of the cameras' noise; 6: heavy rain
  std::vector<ActorPlan> actors;
  std::vector<SpokenWords> spoken;
  std::vector<EdgeNode> edge_nodes;
  std::vector<PlannedFault> faults;

  /// Reads a YAML text. @param name  of the source, in messages. @param seed  of the random ranges.
  /// @throws std::invalid_argument "<source>: <field> = <value>, must be <bound>"; a field that is unknown is refused
  /// with the list of the known ones.
  static Scenario parse(const std::string& yaml, const std::string& name, uint64_t seed);
  /// The same with a file.
  static Scenario load(const std::string& path, uint64_t seed);

  /// Options of the renderer in this light, and with this noise.
  StereoRendererOptions pictures(StereoRendererOptions options) const;

  /// The scenario as one line of JSON, for other programs. @param T_map_world  turns the coordinates into the map.
  std::string toJson(const pi_vehicle::Pose2& T_map_world) const;
};

}  // namespace pi_simulation
