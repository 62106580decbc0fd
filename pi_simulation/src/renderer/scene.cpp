#include "renderer/scene.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

void Primitive::place(const Eigen::Vector3f& sun)
{
  to_unit = half.cwiseInverse().asDiagonal() * rotation.transpose();
  sun_local = rotation.transpose() * sun;
}

Bounds Primitive::bounds() const
{
  Eigen::Vector3f local = half;
  if (shape == Shape::CAPSULE)
  {
    const float thickest = std::max(taper, 1.0f);
    local = half.cwiseProduct(Eigen::Vector3f(thickest, thickest, thickest + 0.5f * length));
  }
  const Eigen::Vector3f reach = rotation.cwiseAbs() * local;
  return {center - reach, center + reach};
}

Motion::State Motion::at(double time_s, double rest_heading) const
{
  const Eigen::Vector2d way = to - from;
  const double length = way.norm();
  if (period_s <= 0.0 || length < 1e-6)
  {
    return {from, Eigen::Vector2d::Zero(), rest_heading, 0.0};
  }
  // 40 % of the period there, 10 % rest, 40 % back, 10 % rest; smoothstep in between, so that velocity is continuous.
  const double p = time_s / period_s + phase - std::floor(time_s / period_s + phase);
  const bool back = p >= 0.5;
  const double x = std::min((back ? p - 0.5 : p) / 0.4, 1.0);
  const double done = x * x * (3.0 - 2.0 * x);
  const double rate = 6.0 * x * (1.0 - x) / (0.4 * period_s);
  const double heading = std::atan2(way.y(), way.x()) + (back ? M_PI : 0.0);
  return {from + way * (back ? 1.0 - done : done), way * (back ? -rate : rate), heading, length * done};
}

std::optional<Motion::State> Scene::stateOf(const SceneObject& object, int64_t stamp_ns,
                                            const std::vector<ActorState>& actors) const
{
  if (object.actor < 0)
  {
    return object.motion.at(seconds(stamp_ns), object.heading);
  }
  const auto index = static_cast<size_t>(object.actor);
  if (index >= actors.size() || !actors[index].present)
  {
    return std::nullopt;
  }
  const ActorState& actor = actors[index];
  return Motion::State{actor.position, actor.velocity, actor.heading, actor.walked};
}

MovingScene Scene::movingAt(int64_t stamp_ns, const std::vector<ActorState>& actors) const
{
  MovingScene moving;
  std::vector<Bounds> bounds;
  for (const SceneObject& object : objects)
  {
    const std::optional<Motion::State> present =
        object.parts.empty() ? std::nullopt : stateOf(object, stamp_ns, actors);
    if (!present)
    {
      continue;
    }
    const Motion::State& state = *present;
    const Eigen::Matrix3f R_world_object =
        Eigen::AngleAxisf(static_cast<float>(state.heading), Eigen::Vector3f::UnitZ()).toRotationMatrix();
    const Eigen::Vector3f p_world_object(static_cast<float>(state.position.x()), static_cast<float>(state.position.y()),
                                         static_cast<float>(object.base.z()));
    Pose pose;
    if (object.figure)
    {
      pose = poseOf(*object.figure, state.distance, state.velocity.norm());
    }
    else
    {
      pose.fill(Eigen::Isometry3f::Identity());
    }
    for (const MovingPart& part : object.parts)
    {
      const Eigen::Isometry3f& bone = pose[static_cast<size_t>(part.bone)];
      Primitive primitive = part.primitive;
      primitive.center = p_world_object + R_world_object * (bone * part.primitive.center);
      primitive.rotation = R_world_object * bone.linear() * part.primitive.rotation;
      primitive.object = object.id;
      primitive.place(sun);
      bounds.push_back(primitive.bounds());
      moving.primitives.push_back(primitive);
    }
  }
  moving.tree = BoundingTree(bounds);
  if (has_sky)
  {
    moving.shadows = Shadows(moving.primitives, 0, sun, static_cast<float>(ground_z));
  }
  return moving;
}

void Scene::finish()
{
  std::vector<Bounds> bounds;
  for (size_t i = 0; i < primitives.size(); ++i)
  {
    primitives[i].place(sun);
    if (i >= unbounded)
    {
      bounds.push_back(primitives[i].bounds());
    }
  }
  tree = BoundingTree(bounds);
  if (has_sky)
  {
    shadows = Shadows(primitives, unbounded, sun, static_cast<float>(ground_z));
  }
}

}  // namespace pi_simulation::synthetic
