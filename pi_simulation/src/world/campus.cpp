#include "world/scene_builder.h"

#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

constexpr float HAZE_M = 75.0f;
constexpr double RING_M = 30.0;  ///< from the path to the buildings that close the horizon

/// A place beside the road.
struct Side
{
  Eigen::Vector2d point;    ///< on the centre line
  Eigen::Vector2d outward;  ///< unit vector to the side
  double heading;           ///< of the road [rad]

  Eigen::Vector3d at(double lateral) const
  {
    return {point.x() + lateral * outward.x(), point.y() + lateral * outward.y(), 0.0};
  }
};

/// Calls `put` about every `step` metres, on both sides of the line in turn.
template <typename Put>
void alongRoad(SceneBuilder* builder, double step, const Put& put)
{
  const std::vector<Eigen::Vector2d>& line = builder->line();
  double next = 0.0;
  double s = 0.0;
  for (size_t i = 1; i < line.size(); ++i)
  {
    const Eigen::Vector2d way = line[i] - line[i - 1];
    s += way.norm();
    if (s < next)
    {
      continue;
    }
    next = s + step * builder->random().uniform(0.7, 1.3);
    const Eigen::Vector2d tangent = way.normalized();
    for (const double sign : {1.0, -1.0})
    {
      put(Side{line[i], sign * Eigen::Vector2d(-tangent.y(), tangent.x()), std::atan2(tangent.y(), tangent.x())});
    }
  }
}

void addBuildings(SceneBuilder* builder)
{
  Random& random = builder->random();
  alongRoad(builder, 2.0,
            [&](const Side& side)
            {
              const Eigen::Vector3d size = random.uniform<3>({8.0, 6.0, 5.0}, {16.0, 9.0, 13.0});
              const double lateral = 7.5 + random.uniform(0.0, 1.5) + 0.5 * size.y();
              builder->place(makeBuilding(&random, size), side.at(lateral), side.heading, 6.8, 0.6);
            });
}

/// Buildings side by side around everything, so that no view leaves the town.
void addRing(SceneBuilder* builder)
{
  Random& random = builder->random();
  const Eigen::Vector2d low = builder->low().head<2>().array() - RING_M;
  const Eigen::Vector2d high = builder->high().head<2>().array() + RING_M;
  for (const bool along_x : {true, false})
  {
    const double from = along_x ? low.x() : low.y();
    const double to = along_x ? high.x() : high.y();
    for (const bool upper : {false, true})
    {
      for (double s = from; s < to;)
      {
        const Eigen::Vector2d drawn = random.uniform<2>({12.0, 9.0}, {22.0, 20.0});
        const Eigen::Vector3d size(drawn.x(), 10.0, drawn.y());
        const double middle = s + 0.5 * size.x();
        const double lateral = along_x ? (upper ? high.y() : low.y()) : (upper ? high.x() : low.x());
        builder->place(makeBuilding(&random, size),
                       along_x ? Eigen::Vector3d(middle, lateral, 0.0) : Eigen::Vector3d(lateral, middle, 0.0),
                       along_x ? 0.0 : M_PI_2, 6.8, -1.0);
        s += size.x();
      }
    }
  }
}

void addMoving(SceneBuilder* builder)
{
  Random& random = builder->random();
  bool crosses = false;
  alongRoad(builder, 9.0,
            [&](const Side& side)
            {
              crosses = !crosses;
              const Eigen::Vector2d tangent(std::cos(side.heading), std::sin(side.heading));
              const Eigen::Vector2d kerb = side.at(4.6).head<2>();
              const Eigen::Vector2d to = crosses ? Eigen::Vector2d(side.at(-4.6).head<2>())
                                                 : Eigen::Vector2d(kerb + random.uniform(6.0, 12.0) * tangent);
              const double speed = random.uniform(0.9, 1.5);
              if (!crosses && random.chance(0.2))
              {
                builder->placeMoving(makeCyclist(&random), kerb, to, 2.0 * speed);
                return;
              }
              const double height = random.chance(0.15) ? random.uniform(1.05, 1.35) : 0.0;
              builder->placeMoving(random.chance(0.85) ? makePerson(&random, height) : makeCart(&random), kerb, to,
                                   speed);
            });
}

void addParked(SceneBuilder* builder)
{
  Random& random = builder->random();
  alongRoad(builder, 9.0,
            [&](const Side& side)
            {
              const double turn = random.chance(0.5) ? 0.0 : M_PI;
              const double lateral = random.uniform(3.9, 4.2);
              builder->place(makeCar(&random), side.at(lateral), side.heading + turn, 2.4, 0.5);
            });
  alongRoad(builder, 7.0,
            [&](const Side& side)
            {
              const double turn = random.uniform(-0.5, 0.5);
              const double lateral = random.uniform(4.2, 6.8);
              builder->place(random.chance(0.25) ? makeCone(&random) : makeBox(&random, 1.1), side.at(lateral),
                             side.heading + turn, 2.4);
            });
}

void addFurniture(SceneBuilder* builder)
{
  Random& random = builder->random();
  alongRoad(builder, 15.0,
            [&](const Side& side) { builder->place(makeLampPost(&random), side.at(3.5), side.heading + M_PI_2, 2.4); });
  alongRoad(builder, 8.0,
            [&](const Side& side)
            {
              const double turn = random.uniform(-0.3, 0.3);
              const double lateral = random.uniform(3.4, 4.0);
              builder->place(makeSign(&random), side.at(lateral), side.heading + turn, 2.4);
            });
  alongRoad(builder, 6.0,
            [&](const Side& side)
            {
              const double heading = random.uniform(-3.1, 3.1);
              const double lateral = random.uniform(5.2, 7.0);
              builder->place(makeTree(&random), side.at(lateral), heading, 1.6);
            });
}

}  // namespace

void buildCampus(const SyntheticWorldOptions& options, const std::vector<pi_slam::StampedPose>& drive, Scene* scene)
{
  SceneBuilder builder(options, drive, false, scene);
  scene->has_sky = true;
  scene->haze_m = HAZE_M;
  scene->road = RoadMap(builder.line());
  Primitive ground;
  ground.shape = Shape::GROUND;
  ground.material = Material::STREET;
  ground.center.z() = static_cast<float>(options.ground_z);
  ground.half.setConstant(1.0f);
  builder.addUnbounded(ground);
  addActors(options.actors, options.seed + 1, &builder);
  if (options.crossing)
  {
    addMoving(&builder);
  }
  builder.setAbsent(!options.parked);
  addParked(&builder);
  builder.setAbsent(false);
  addBuildings(&builder);
  addFurniture(&builder);
  addRing(&builder);
}

}  // namespace pi_simulation::synthetic
