#include "world/scene_builder.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

/// The room, in world coordinates in plan and above the floor in height.
struct Room
{
  Eigen::Vector2d low;
  Eigen::Vector2d high;
  double height;

  double area() const { return (high - low).prod(); }
  /// Any point that is `inset` or more from the walls.
  Eigen::Vector2d any(double inset, Random* random) const
  {
    return random->uniform<2>(low.array() + inset, high.array() - inset);
  }
};

/// Calls `put(centre, heading, width)` for pieces of wall side by side; heading looks into the room.
template <typename Put>
void alongWalls(const Room& room, Random* random, double shortest, double longest, double distance, const Put& put)
{
  for (int wall = 0; wall < 4; ++wall)
  {
    const bool along_x = wall % 2 == 0;
    const bool upper = wall >= 2;
    const double from = along_x ? room.low.x() : room.low.y();
    const double to = along_x ? room.high.x() : room.high.y();
    const double across = along_x ? (upper ? room.high.y() : room.low.y()) : (upper ? room.high.x() : room.low.x());
    const double inset = upper ? across - distance : across + distance;
    const double heading = along_x ? (upper ? -M_PI_2 : M_PI_2) : (upper ? M_PI : 0.0);
    for (double s = from + 0.3; s < to - shortest;)
    {
      const double width = random->uniform(shortest, longest);
      const double middle = s + 0.5 * width;
      put(along_x ? Eigen::Vector2d(middle, inset) : Eigen::Vector2d(inset, middle), heading, width);
      s += width + random->uniform(0.05, 0.6);
    }
  }
}

void addWallThings(const Room& room, SceneBuilder* builder)
{
  Random& random = builder->random();
  alongWalls(room, &random, 1.2, 3.0, 0.35,
             [&](const Eigen::Vector2d& p, double heading, double width)
             {
               const double height = random.uniform(1.0, std::min(3.0, 0.6 * room.height));
               const Prop prop =
                   random.chance(0.7) ? makeShelf(&random, width, height) : makeMachine(&random, {width, 0.6, height});
               builder->place(prop, {p.x(), p.y(), 0.0}, heading + M_PI_2, 0.9);
             });
  for (double bottom = 0.8; bottom + 1.0 < room.height; bottom += 1.7)
  {
    alongWalls(room, &random, 0.8, 1.8, 0.02,
               [&](const Eigen::Vector2d& p, double heading, double width)
               {
                 const Prop poster = makePoster(&random, 0.85 * width, random.uniform(0.6, 1.3));
                 builder->place(poster, {p.x(), p.y(), bottom + random.uniform(0.0, 0.3)}, heading, 0.3, -1.0);
               });
  }
  for (const double height : {0.55, 0.72})
  {
    alongWalls(room, &random, 6.0, 12.0, 0.5,
               [&](const Eigen::Vector2d& p, double heading, double width)
               {
                 const Prop pipe = makePipe(&random, width, height * room.height, random.uniform(0.1, 0.3));
                 builder->place(pipe, {p.x(), p.y(), 0.0}, heading + M_PI_2, 0.8, -1.0);
               });
  }
}

void addMoving(const Room& room, SceneBuilder* builder)
{
  Random& random = builder->random();
  const int wanted = std::clamp(static_cast<int>(room.area() / 40.0), 2, 12);
  int placed = 0;
  for (int attempt = 0; attempt < 40 * wanted && placed < wanted; ++attempt)
  {
    const Eigen::Vector2d from = room.any(1.2, &random);
    const double heading = random.uniform(-M_PI, M_PI);
    const Eigen::Vector2d to = from + random.uniform(3.0, 7.0) * Eigen::Vector2d(std::cos(heading), std::sin(heading));
    if ((to - room.low).minCoeff() < 1.2 || (room.high - to).minCoeff() < 1.2)
    {
      continue;
    }
    const Prop prop = random.chance(0.75) ? makePerson(&random) : makeCart(&random);
    placed += builder->placeMoving(prop, from, to, random.uniform(0.8, 1.4)) ? 1 : 0;
  }
}

/// Things on the floor wherever the path leaves room.
void addFloorThings(const Room& room, bool parked, SceneBuilder* builder)
{
  Random& random = builder->random();
  const int attempts = static_cast<int>(room.area() * 2.0);
  for (int i = 0; i < attempts; ++i)
  {
    const Eigen::Vector2d base = room.any(1.0, &random);
    const double heading =
        random.chance(0.6) ? M_PI_2 * std::floor(random.uniform(0.0, 4.0)) : random.uniform(-3.1, 3.1);
    const double kind = random.uniform(0.0, 1.0);
    Prop prop;
    if (kind < 0.12)
    {
      prop = makePillar(&random, room.height);
    }
    else if (kind < 0.35)
    {
      const Eigen::Vector2d size = random.uniform<2>({1.2, 1.2}, {3.0, 2.4});
      prop = makeShelf(&random, size.x(), size.y());
    }
    else if (kind < 0.65)
    {
      prop = makeMachine(&random, {random.uniform(0.8, 2.2), random.uniform(0.7, 1.4), random.uniform(0.7, 1.8)});
    }
    else if (kind < 0.75)
    {
      prop = makeSign(&random);
    }
    else
    {
      prop = makeBox(&random, 1.2);
    }
    const bool box = prop.class_name == "box";
    builder->setAbsent(box && !parked);
    // Bulky things keep apart, else one could not see through the hall.
    builder->place(prop, {base.x(), base.y(), 0.0}, heading, 1.0, box ? 0.3 : 1.5);
    builder->setAbsent(false);
  }
}

void addCeilingThings(const Room& room, SceneBuilder* builder)
{
  Random& random = builder->random();
  for (int i = 0; i < static_cast<int>(room.area() / 12.0); ++i)
  {
    const Eigen::Vector2d base = room.any(1.0, &random);
    builder->place(makeHangingLamp(&random, room.height), {base.x(), base.y(), 0.0}, 0.0, 0.8, -1.0);
  }
  for (double y = room.low.y() + 2.0; y < room.high.y() - 1.0; y += 4.0)
  {
    const double x = 0.5 * (room.low.x() + room.high.x());
    const double length = 0.95 * (room.high.x() - room.low.x());
    builder->place(makePipe(&random, length, room.height - 0.6, random.uniform(0.12, 0.3)), {x, y, 0.0}, 0.0, 0.8,
                   -1.0);
  }
}

}  // namespace

void buildHall(const SyntheticWorldOptions& options, const std::vector<pi_slam::StampedPose>& drive, Scene* scene)
{
  double lowest = drive.front().T_world_body.translation().z();
  double highest = lowest;
  for (const pi_slam::StampedPose& pose : drive)
  {
    lowest = std::min(lowest, pose.T_world_body.translation().z());
    highest = std::max(highest, pose.T_world_body.translation().z());
  }
  SceneBuilder builder(options, drive, highest - lowest > 0.3, scene);
  addActors(options.actors, options.seed + 1, &builder);
  const Eigen::Vector2d extent = (builder.high() - builder.low()).head<2>();
  const double margin = std::clamp(0.25 * extent.maxCoeff(), 3.5, 7.0);
  Room room;
  room.low = builder.low().head<2>().array() - margin;
  room.high = builder.high().head<2>().array() + margin;
  room.height = std::max(5.0, builder.high().z() - options.ground_z + 2.5);

  scene->has_sky = false;
  scene->sun = Eigen::Vector3f(0.25f, 0.15f, 0.96f).normalized();
  scene->ambient = 0.62f;
  Primitive shell;
  shell.shape = Shape::ROOM;
  shell.material = Material::HALL_SHELL;
  shell.center.head<2>() = (0.5 * (room.low + room.high)).cast<float>();
  shell.center.z() = static_cast<float>(options.ground_z + 0.5 * room.height);
  shell.half.head<2>() = (0.5 * (room.high - room.low)).cast<float>();
  shell.half.z() = static_cast<float>(0.5 * room.height);
  shell.seed = builder.random().seed();
  builder.addUnbounded(shell);
  if (options.crossing)
  {
    addMoving(room, &builder);
  }
  addWallThings(room, &builder);
  addFloorThings(room, options.parked, &builder);
  addCeilingThings(room, &builder);
}

}  // namespace pi_simulation::synthetic
