#pragma once

#include <pi_slam/trajectory_file.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace pi_simulation
{

namespace synthetic
{
struct Scene;
}

enum class WorldKind
{
  CAMPUS,  ///< street under the sky: road, kerb, facades, trees, poles, signs, parked cars, walking people
  HALL,    ///< closed room around the path: walls with posters, tiles, pillars, shelves, machines, lamps
};

/// Whether there is such a class of actors. In scene_builder.cpp.
bool isActorClass(const std::string& name);
/// All of them, for errors.
std::string actorClasses();

/// An object that is moved from outside: its owner passes its place with each picture.
struct ActorOptions
{
  std::string class_name;                          ///< one of actorClasses()
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< box, kerb; of a person the height only [m]; 0: by the seed
  std::vector<Eigen::Vector2d> way;                ///< where it will go; nothing that stands is placed there [m]
};

/// Place of an actor.
struct ActorState
{
  bool present = false;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< world [m]
  double heading = 0.0;                                ///< [rad]
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  ///< [m/s]
  double walked = 0.0;                                 ///< [m]; legs swing with it
};

struct SyntheticWorldOptions
{
  WorldKind kind = WorldKind::CAMPUS;
  uint64_t seed = 1;
  bool parked = true;    ///< parked cars and boxes beside the way; without them all else stands as if they were there
  bool crossing = true;  ///< people and carts that move, some across the way
  std::vector<ActorOptions> actors;
  double ground_z = 0.0;  ///< height of the ground or floor in the world [m], below the whole path

  /// Centre line of the road, [m]; empty: the path itself. Give the whole round here if the drive ends before it.
  std::vector<Eigen::Vector2d> road;
};

/// An object that a vehicle could hit, at one time.
struct ObstacleState
{
  int id = 0;              ///< 1 or more, constant
  std::string class_name;  ///< one of actorClasses(), or tree, pole, sign, building, pillar, shelf, machine, pipe, lamp
  Eigen::Isometry3d T_world_object = Eigen::Isometry3d::Identity();  ///< centre of its box, x along its direction
  Eigen::Vector3d size = Eigen::Vector3d::Zero();                    ///< of its box, along its own axes [m]
  Eigen::Vector3d v_world = Eigen::Vector3d::Zero();                 ///< [m/s]
  int actor = -1;  ///< its number in SyntheticWorldOptions::actors; -1: a thing of the world's own
};

/// A textured world of simple shapes, laid out around a path: every view has texture, and the path stays free. Moving
/// objects keep at least 1.2 m away from the drive. Immutable once built: any thread may use it.
class SyntheticWorld
{
public:
  /// @param drive  poses of the body over time, two or more; also fixes time zero of the moving things.
  /// @throws std::invalid_argument for fewer poses, a drive below the ground, one longer than 2 km across, or an actor
  /// of a class that is unknown.
  static std::shared_ptr<const SyntheticWorld> build(const SyntheticWorldOptions& options,
                                                     const std::vector<pi_slam::StampedPose>& drive);
  ~SyntheticWorld();

  /// All standing and moving objects except ground, walls and ceiling, in order of id.
  /// @param actors  where they are; those that are missing here, or not present, are left out.
  std::vector<ObstacleState> obstaclesAt(int64_t stamp_ns, const std::vector<ActorState>& actors = {}) const;

  /// Shapes and textures, for StereoRenderer.
  const synthetic::Scene& scene() const { return *scene_; }

private:
  SyntheticWorld();
  std::unique_ptr<synthetic::Scene> scene_;
};

}  // namespace pi_simulation
