#pragma once

#include "renderer/scene.h"
#include "world/props.h"
#include "world/synthetic_world.h"

#include <vector>

namespace pi_simulation::synthetic
{

/// Places props in a scene without contact with the drive or with each other.
class SceneBuilder
{
public:
  /// @param free_flight  the body moves in all directions: things may stand below its path. Otherwise it is a vehicle,
  ///                     which fills the space between its path and the ground.
  SceneBuilder(const SyntheticWorldOptions& options, const std::vector<pi_slam::StampedPose>& drive, bool free_flight,
               Scene* scene);

  /// Adds a primitive that every ray is tested against; all of them before the first prop.
  void addUnbounded(const Primitive& primitive);

  /// Places a prop that stands still.
  /// @param base       its origin; z is above the ground [m].
  /// @param clearance  from the path to every part [m].
  /// @param gap        to other props, on the ground [m]; below 0: may touch them (things on walls, under ceilings).
  /// @return false if there is no room: nothing was added.
  bool place(const Prop& prop, const Eigen::Vector3d& base, double heading, double clearance, double gap = 0.2);

  /// Places a prop that moves back and forth between two points on the ground. It may cross the path while the drive is
  /// elsewhere: of 24 phases of the motion, the one that stays farthest from the drive is used.
  /// @return false if the drive came closer than 1.2 m at any phase, or a prop stands there.
  bool placeMoving(const Prop& prop, const Eigen::Vector2d& from, const Eigen::Vector2d& to, double speed);

  /// Adds an actor, and keeps its way free of later props.
  void addActor(const Prop& prop, const std::vector<Eigen::Vector2d>& way);

  /// While set, place() keeps the room of a prop, but does not add it.
  void setAbsent(bool absent) { absent_ = absent; }

  Random& random() { return random_; }
  /// Smallest and largest position of the path, road included [m].
  const Eigen::Vector3d& low() const { return low_; }
  const Eigen::Vector3d& high() const { return high_; }
  /// Centre line of the road, about every metre.
  const std::vector<Eigen::Vector2d>& line() const { return line_; }

private:
  /// A rectangle on the ground.
  struct Footprint
  {
    Eigen::Vector2d center;
    Eigen::Vector2d axis;  ///< unit vector of its first side
    Eigen::Vector2d half;
  };
  /// A place of the body, from `low` to `high` above the ground.
  struct PathPoint
  {
    Eigen::Vector2d position;
    double low;
    double high;
  };

  static bool overlap(const Footprint& a, const Footprint& b, double gap);
  bool isFree(const Footprint& footprint, double gap) const;
  bool clearsPath(const Prop& prop, const Eigen::Vector3d& base, double heading, double clearance) const;
  double closestApproach(const Motion& motion, double radius) const;
  int addObject(const Prop& prop, const Eigen::Vector3d& base, double heading);

  Scene* scene_;
  Random random_;
  std::vector<pi_slam::StampedPose> drive_;  ///< thinned to 0.1 s
  std::vector<PathPoint> path_;              ///< thinned to 0.15 m
  std::vector<Eigen::Vector2d> line_;
  std::vector<Footprint> taken_;
  int actors_ = 0;
  bool absent_ = false;
  Eigen::Vector3d low_;
  Eigen::Vector3d high_;
};

/// Adds all actors. @throws std::invalid_argument for a class that is unknown.
void addActors(const std::vector<ActorOptions>& actors, uint64_t seed, SceneBuilder* builder);

/// Fill an empty scene. In campus.cpp and hall.cpp.
void buildCampus(const SyntheticWorldOptions& options, const std::vector<pi_slam::StampedPose>& drive, Scene* scene);
void buildHall(const SyntheticWorldOptions& options, const std::vector<pi_slam::StampedPose>& drive, Scene* scene);

}  // namespace pi_simulation::synthetic
