#include "world/synthetic_world.h"

#include "renderer/scene.h"
#include "world/scene_builder.h"

#include <algorithm>
#include <stdexcept>

namespace pi_simulation
{

SyntheticWorld::SyntheticWorld() : scene_(std::make_unique<synthetic::Scene>()) {}

SyntheticWorld::~SyntheticWorld() = default;

namespace
{

constexpr double MAX_EXTENT_M = 2000.0;

struct Extent
{
  Eigen::Vector3d low;
  Eigen::Vector3d high;
};

Extent extentOf(const std::vector<pi_slam::StampedPose>& drive)
{
  if (drive.size() < 2)
  {
    throw std::invalid_argument("world: the drive has " + std::to_string(drive.size()) + " poses, needs two or more");
  }
  Extent extent{drive.front().T_world_body.translation(), drive.front().T_world_body.translation()};
  for (const pi_slam::StampedPose& pose : drive)
  {
    extent.low = extent.low.cwiseMin(pose.T_world_body.translation());
    extent.high = extent.high.cwiseMax(pose.T_world_body.translation());
  }
  return extent;
}

}  // namespace

std::shared_ptr<const SyntheticWorld> SyntheticWorld::build(const SyntheticWorldOptions& options,
                                                            const std::vector<pi_slam::StampedPose>& drive)
{
  const Extent extent = extentOf(drive);
  if (extent.low.z() <= options.ground_z)
  {
    throw std::invalid_argument("world: the drive goes down to z = " + std::to_string(extent.low.z()) +
                                " m, must stay above ground_z = " + std::to_string(options.ground_z));
  }
  if (!((extent.high - extent.low).maxCoeff() <= MAX_EXTENT_M))
  {
    throw std::invalid_argument("world: the drive is " + std::to_string((extent.high - extent.low).maxCoeff()) +
                                " m across, must be at most 2000 m");
  }
  std::shared_ptr<SyntheticWorld> world(new SyntheticWorld);
  synthetic::Scene& scene = *world->scene_;
  scene.seed = static_cast<uint32_t>(options.seed * 2654435761u);
  scene.origin_ns = drive.front().stamp_ns;
  scene.ground_z = options.ground_z;
  (options.kind == WorldKind::CAMPUS ? synthetic::buildCampus : synthetic::buildHall)(options, drive, &scene);
  scene.finish();
  return world;
}

std::vector<ObstacleState> SyntheticWorld::obstaclesAt(int64_t stamp_ns, const std::vector<ActorState>& actors) const
{
  std::vector<ObstacleState> states;
  for (const synthetic::SceneObject& object : scene_->objects)
  {
    const std::optional<synthetic::Motion::State> present = scene_->stateOf(object, stamp_ns, actors);
    if (!present)
    {
      continue;
    }
    const synthetic::Motion::State& motion = *present;
    ObstacleState state;
    state.id = object.id;
    state.class_name = object.class_name;
    state.actor = object.actor;
    state.size = object.size;
    state.T_world_object.linear() = Eigen::AngleAxisd(motion.heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    state.T_world_object.translation() << motion.position, object.base.z() + 0.5 * object.size.z();
    state.v_world << motion.velocity, 0.0;
    states.push_back(state);
  }
  return states;
}

}  // namespace pi_simulation
