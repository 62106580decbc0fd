#include "world/scene_builder.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <stdexcept>

namespace pi_simulation::synthetic
{

namespace
{

constexpr double PATH_STEP_M = 0.15;
constexpr double DRIVE_STEP_S = 0.1;
constexpr double HEAD_ROOM_M = 0.5;   ///< a vehicle reaches that far above its body frame
constexpr double MOVING_GAP_M = 1.2;  ///< between a moving thing and the drive
constexpr int PHASES = 24;

Eigen::Vector2d direction(double heading)
{
  return {std::cos(heading), std::sin(heading)};
}

}  // namespace

SceneBuilder::SceneBuilder(const SyntheticWorldOptions& options, const std::vector<pi_slam::StampedPose>& drive,
                           bool free_flight, Scene* scene)
  : scene_(scene), random_(options.seed), low_(drive.front().T_world_body.translation()), high_(low_)
{
  const auto add = [&](const Eigen::Vector3d& p)
  {
    low_ = low_.cwiseMin(p);
    high_ = high_.cwiseMax(p);
    const double height = p.z() - options.ground_z;
    const PathPoint point{p.head<2>(), free_flight ? height : 0.0, free_flight ? height : height + HEAD_ROOM_M};
    if (path_.empty() || (path_.back().position - point.position).norm() > PATH_STEP_M ||
        std::abs(path_.back().high - point.high) > PATH_STEP_M)
    {
      path_.push_back(point);
    }
  };
  for (const pi_slam::StampedPose& pose : drive)
  {
    add(pose.T_world_body.translation());
    if (drive_.empty() || 1e-9 * static_cast<double>(pose.stamp_ns - drive_.back().stamp_ns) >= DRIVE_STEP_S)
    {
      drive_.push_back(pose);
    }
  }
  const double height = drive.front().T_world_body.translation().z();
  for (const Eigen::Vector2d& point : options.road)
  {
    add({point.x(), point.y(), height});
  }
  const auto extend = [&](const Eigen::Vector2d& point)
  {
    if (line_.empty() || (line_.back() - point).norm() >= 0.9)
    {
      line_.push_back(point);
    }
  };
  if (options.road.empty())
  {
    for (const pi_slam::StampedPose& pose : drive)
    {
      extend(pose.T_world_body.translation().head<2>());
    }
  }
  std::for_each(options.road.begin(), options.road.end(), extend);
}

void SceneBuilder::addUnbounded(const Primitive& primitive)
{
  scene_->primitives.push_back(primitive);
  scene_->unbounded = scene_->primitives.size();
}

/// Separating axis test of two rectangles.
bool SceneBuilder::overlap(const Footprint& a, const Footprint& b, double gap)
{
  const Eigen::Vector2d way = b.center - a.center;
  const auto reach = [](const Footprint& f, const Eigen::Vector2d& axis)
  {
    const Eigen::Vector2d normal(-f.axis.y(), f.axis.x());
    return f.half.x() * std::abs(f.axis.dot(axis)) + f.half.y() * std::abs(normal.dot(axis));
  };
  for (const Footprint* f : {&a, &b})
  {
    for (const Eigen::Vector2d& axis : {f->axis, Eigen::Vector2d(-f->axis.y(), f->axis.x())})
    {
      if (std::abs(way.dot(axis)) > reach(a, axis) + reach(b, axis) + gap)
      {
        return false;
      }
    }
  }
  return true;
}

bool SceneBuilder::isFree(const Footprint& footprint, double gap) const
{
  return std::none_of(taken_.begin(), taken_.end(),
                      [&](const Footprint& other) { return overlap(footprint, other, gap); });
}

bool SceneBuilder::clearsPath(const Prop& prop, const Eigen::Vector3d& base, double heading, double clearance) const
{
  const Eigen::Vector2d x = direction(heading);
  const Eigen::Vector2d y(-x.y(), x.x());
  for (const MovingPart& part : prop.parts)
  {
    const Bounds bounds = part.primitive.bounds();
    const Eigen::Vector3d half = (0.5f * (bounds.high - bounds.low)).cast<double>();
    const Eigen::Vector3d center = (0.5f * (bounds.high + bounds.low)).cast<double>();
    const double bottom = base.z() + center.z() - half.z();
    const double top = base.z() + center.z() + half.z();
    for (const PathPoint& point : path_)
    {
      const Eigen::Vector2d way = point.position - base.head<2>();
      const Eigen::Vector3d outside(std::abs(way.dot(x) - center.x()) - half.x(),
                                    std::abs(way.dot(y) - center.y()) - half.y(),
                                    std::max(bottom - point.high, point.low - top));
      if (outside.cwiseMax(0.0).squaredNorm() < clearance * clearance)
      {
        return false;
      }
    }
  }
  return true;
}

int SceneBuilder::addObject(const Prop& prop, const Eigen::Vector3d& base, double heading)
{
  if (prop.class_name.empty())
  {
    return 0;
  }
  SceneObject object;
  object.id = static_cast<int>(scene_->objects.size()) + 1;
  object.class_name = prop.class_name;
  object.size = prop.size;
  object.base = base + Eigen::Vector3d(0.0, 0.0, scene_->ground_z);
  object.heading = heading;
  object.motion.from = object.motion.to = base.head<2>();
  scene_->objects.push_back(object);
  return object.id;
}

bool SceneBuilder::place(const Prop& prop, const Eigen::Vector3d& base, double heading, double clearance, double gap)
{
  const Footprint footprint{base.head<2>(), direction(heading), 0.5 * prop.size.head<2>()};
  if (!clearsPath(prop, base, heading, clearance) || (gap >= 0.0 && !isFree(footprint, gap)))
  {
    return false;
  }
  if (gap >= 0.0)
  {
    taken_.push_back(footprint);
  }
  if (absent_)
  {
    return true;
  }
  const int id = addObject(prop, base, heading);
  const Eigen::Matrix3f rotation =
      Eigen::AngleAxisf(static_cast<float>(heading), Eigen::Vector3f::UnitZ()).toRotationMatrix();
  const Eigen::Vector3f origin = (base + Eigen::Vector3d(0.0, 0.0, scene_->ground_z)).cast<float>();
  for (const MovingPart& part : prop.parts)
  {
    Primitive primitive = part.primitive;
    primitive.center = origin + rotation * primitive.center;
    primitive.rotation = rotation * primitive.rotation;
    primitive.object = id;
    scene_->primitives.push_back(primitive);
  }
  return true;
}

double SceneBuilder::closestApproach(const Motion& motion, double radius) const
{
  double closest = std::numeric_limits<double>::max();
  for (const pi_slam::StampedPose& pose : drive_)
  {
    const Motion::State state = motion.at(scene_->seconds(pose.stamp_ns), 0.0);
    closest = std::min(closest, (pose.T_world_body.translation().head<2>() - state.position).norm() - radius);
  }
  return closest;
}

bool SceneBuilder::placeMoving(const Prop& prop, const Eigen::Vector2d& from, const Eigen::Vector2d& to, double speed)
{
  const Eigen::Vector2d way = to - from;
  const Footprint corridor{0.5 * (from + to), way.normalized(),
                           0.5 * Eigen::Vector2d(way.norm() + prop.size.x(), prop.size.y())};
  if (!isFree(corridor, 0.3))
  {
    return false;
  }
  Motion motion;
  motion.from = from;
  motion.to = to;
  motion.period_s = way.norm() / speed / 0.4;  // each way takes 40 % of it
  double best = 0.0;
  double best_phase = 0.0;
  for (int i = 0; i < PHASES; ++i)
  {
    motion.phase = static_cast<double>(i) / PHASES;
    const double closest = closestApproach(motion, 0.5 * prop.size.head<2>().maxCoeff());
    if (closest > best)
    {
      best = closest;
      best_phase = motion.phase;
    }
  }
  if (best < MOVING_GAP_M)
  {
    return false;
  }
  motion.phase = best_phase;
  taken_.push_back(corridor);
  const int id = addObject(prop, {from.x(), from.y(), 0.0}, std::atan2(way.y(), way.x()));
  SceneObject& object = scene_->objects[static_cast<size_t>(id) - 1];
  object.motion = motion;
  object.parts = prop.parts;
  object.figure = prop.figure;
  return true;
}

void SceneBuilder::addActor(const Prop& prop, const std::vector<Eigen::Vector2d>& way)
{
  const Eigen::Vector2d first = way.empty() ? Eigen::Vector2d::Zero() : way.front();
  const int id = addObject(prop, {first.x(), first.y(), 0.0}, 0.0);
  SceneObject& object = scene_->objects[static_cast<size_t>(id) - 1];
  object.parts = prop.parts;
  object.figure = prop.figure;
  object.actor = actors_++;
  const double radius = 0.5 * prop.size.head<2>().norm();
  for (size_t i = 0; i < way.size(); ++i)
  {
    const Eigen::Vector2d a = way[i == 0 ? 0 : i - 1];
    const Eigen::Vector2d edge = way[i] - a;
    const Eigen::Vector2d axis = edge.norm() > 1e-6 ? Eigen::Vector2d(edge.normalized()) : Eigen::Vector2d::UnitX();
    taken_.push_back({0.5 * (a + way[i]), axis, {0.5 * edge.norm() + radius, radius}});
  }
}

namespace
{

Prop makeSizedBox(const Eigen::Vector3d& size, Random* random)
{
  Prop box = makeBox(random, 1.1);
  if ((size.array() > 0.0).all())
  {
    box.size = size;
    box.parts.front().primitive.half = (0.5 * size).cast<float>();
    box.parts.front().primitive.center.z() = static_cast<float>(0.5 * size.z());
  }
  return box;
}

using MakeActor = std::function<Prop(const Eigen::Vector3d& size, Random* random)>;

const std::map<std::string, MakeActor>& actorMakers()
{
  using Size = Eigen::Vector3d;
  static const std::map<std::string, MakeActor> makers = {
      {"person", [](const Size& size, Random* random) { return makePerson(random, size.z()); }},
      {"cyclist", [](const Size&, Random* random) { return makeCyclist(random); }},
      {"car", [](const Size&, Random* random) { return makeCar(random); }},
      {"cart", [](const Size&, Random* random) { return makeCart(random); }},
      {"box", makeSizedBox},
      {"cone", [](const Size&, Random* random) { return makeCone(random); }},
      {"kerb", [](const Size& size, Random* random)
       { return makeKerb(random, (size.array() > 0.0).all() ? size : Size(0.3, 2.0, 0.15)); }},
  };
  return makers;
}

}  // namespace

void addActors(const std::vector<ActorOptions>& actors, uint64_t seed, SceneBuilder* builder)
{
  Random random(seed);
  for (const ActorOptions& actor : actors)
  {
    const auto make = actorMakers().find(actor.class_name);
    if (make == actorMakers().end())
    {
      throw std::invalid_argument("world: an actor of class \"" + actor.class_name + "\", must be " + actorClasses());
    }
    builder->addActor(make->second(actor.size, &random), actor.way);
  }
}

}  // namespace pi_simulation::synthetic

namespace pi_simulation
{

bool isActorClass(const std::string& name)
{
  return synthetic::actorMakers().count(name) > 0;
}

std::string actorClasses()
{
  std::string text;
  for (const auto& maker : synthetic::actorMakers())
  {
    text += (text.empty() ? "" : ", ") + maker.first;
  }
  return text;
}

}  // namespace pi_simulation
