#include "world/props.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

Eigen::Vector3f vector(double x, double y, double z)
{
  return Eigen::Vector3d(x, y, z).cast<float>();
}

/// A box, or another shape, of size `half` around `center`.
MovingPart part(Shape shape, Material material, const Eigen::Vector3f& center, const Eigen::Vector3f& half,
                const Eigen::Vector3f& color, Random* random)
{
  MovingPart result;
  result.primitive.shape = shape;
  result.primitive.material = material;
  result.primitive.center = center;
  result.primitive.half = half;
  result.primitive.color = color;
  result.primitive.seed = random->seed();
  return result;
}

Eigen::Vector3f grey(Random* random, double low, double high)
{
  const double value = random->uniform(low, high);
  return vector(value, value, value);
}

/// Anything from muted to strong.
Eigen::Vector3f anyColor(Random* random)
{
  return random->uniform<3>({0.1, 0.1, 0.1}, {0.85, 0.85, 0.85}).cast<float>();
}

}  // namespace

Prop makeTree(Random* random)
{
  Prop tree{"tree", {}, {}};
  const double trunk = random->uniform(2.4, 3.2);
  const double radius = random->uniform(0.12, 0.22);
  tree.size = {2.0 * radius, 2.0 * radius, trunk + 2.0};
  tree.parts.push_back(part(Shape::CYLINDER, Material::BARK, vector(0, 0, 0.5 * trunk + 0.3),
                            vector(radius, radius, 0.5 * trunk + 0.3), vector(0.36, 0.28, 0.2), random));
  const Eigen::Vector3f green = random->uniform<3>({0.26, 0.4, 0.14}, {0.38, 0.52, 0.22}).cast<float>();
  for (int i = 0; i < 9; ++i)
  {
    const double size = random->uniform(0.5, 0.9);
    const Eigen::Vector3d branch = random->uniform<3>({-0.7, -0.7, 0.0}, {0.7, 0.7, 1.5});
    tree.parts.push_back(part(Shape::SPHERE, Material::FOLIAGE,
                              vector(branch.x(), branch.y(), trunk + 0.5 + branch.z()), vector(size, size, 0.8 * size),
                              green, random));
  }
  return tree;
}

Prop makeLampPost(Random* random)
{
  Prop post{"pole", {0.16, 0.16, 5.5}, {}};
  const Eigen::Vector3f color = grey(random, 0.15, 0.55);
  post.parts.push_back(
      part(Shape::CYLINDER, Material::METAL, vector(0, 0, 2.75), vector(0.08, 0.08, 2.75), color, random));
  post.parts.push_back(
      part(Shape::BOX, Material::LAMP, vector(0, 0, 5.6), vector(0.3, 0.14, 0.1), vector(0.95, 0.95, 0.9), random));
  return post;
}

Prop makeSign(Random* random)
{
  Prop sign{"sign", {0.12, 0.9, 2.7}, {}};
  sign.parts.push_back(part(Shape::CYLINDER, Material::METAL, vector(0, 0, 1.1), vector(0.04, 0.04, 1.1),
                            grey(random, 0.4, 0.7), random));
  const Eigen::Vector3f color = anyColor(random);
  const Eigen::Vector2d half = random->uniform<2>({0.3, 0.25}, {0.45, 0.45});
  MovingPart board =
      part(Shape::BOX, Material::SIGN, vector(0, 0, 2.2), vector(0.02, half.x(), half.y()), color, random);
  board.primitive.accent = board.primitive.color.sum() > 1.5f ? vector(0.08, 0.08, 0.1) : vector(0.92, 0.92, 0.9);
  sign.parts.push_back(board);
  return sign;
}

Prop makeCar(Random* random)
{
  // White, black, greys, then the colours that are seen less often.
  static const float COLORS[][3] = {{0.85f, 0.85f, 0.84f}, {0.06f, 0.06f, 0.07f}, {0.55f, 0.56f, 0.58f},
                                    {0.27f, 0.28f, 0.30f}, {0.60f, 0.07f, 0.07f}, {0.10f, 0.18f, 0.45f},
                                    {0.30f, 0.42f, 0.55f}, {0.12f, 0.30f, 0.18f}, {0.75f, 0.62f, 0.20f},
                                    {0.45f, 0.36f, 0.28f}};
  constexpr double LENGTH = 4.2;
  constexpr double WIDTH = 1.76;
  const auto choice = static_cast<size_t>(random->uniform(0.0, 10.0));
  const float* chosen = COLORS[std::min<size_t>(choice, 9)];
  const Eigen::Vector3f color(chosen[0], chosen[1], chosen[2]);
  const double height = random->uniform(1.44, 1.6);
  Prop car{"car", {LENGTH, WIDTH, height}, {}};
  const auto wedge = [&](Material material, const Eigen::Vector3f& center, const Eigen::Vector3f& half, double front,
                         double rear, double sides) -> Primitive&
  {
    car.parts.push_back(part(Shape::WEDGE, material, center, half, color, random));
    Primitive& primitive = car.parts.back().primitive;
    primitive.taper = static_cast<float>(front);
    primitive.rear = static_cast<float>(rear);
    primitive.sides = static_cast<float>(sides);
    return primitive;
  };
  wedge(Material::CAR_PAINT, vector(0, 0, 0.44), vector(2.1, 0.87, 0.23), 0.0, 0.0, 0.0).accent =
      vector(0.95, 0.9, 0.8);
  wedge(Material::CAR_PAINT, vector(0, 0, 0.78), vector(2.08, 0.86, 0.12), 0.06, 0.04, 0.06).accent =
      vector(0.9, 0.88, 0.85);
  const bool hatchback = random->chance(0.5);
  const double cabin = 0.5 * (height - 0.9);
  wedge(Material::GLASS, vector(hatchback ? -0.45 : -0.3, 0, 0.9 + cabin), vector(hatchback ? 1.45 : 1.25, 0.79, cabin),
        0.55, hatchback ? 0.25 : 0.5, 0.28);
  wedge(Material::CAR_PAINT, vector(hatchback ? -0.62 : -0.3, 0, height - 0.01),
        vector(hatchback ? 0.9 : 0.66, 0.58, 0.02), 0.2, 0.2, 0.1)
      .accent = color;
  for (const double x : {-1.28, 1.3})
  {
    for (const double y : {-0.77, 0.77})
    {
      for (const bool rim : {false, true})
      {
        const double radius = rim ? 0.2 : 0.32;
        MovingPart wheel = part(Shape::CYLINDER, rim ? Material::METAL : Material::RUBBER, vector(x, y, 0.32),
                                vector(radius, radius, rim ? 0.125 : 0.12),
                                rim ? vector(0.5, 0.5, 0.52) : vector(0.05, 0.05, 0.05), random);
        wheel.primitive.accent = vector(0.3, 0.3, 0.32);
        wheel.primitive.rotation =
            Eigen::AngleAxisf(static_cast<float>(M_PI_2), Eigen::Vector3f::UnitX()).toRotationMatrix();
        car.parts.push_back(wheel);
      }
    }
  }
  return car;
}

Prop makeCone(Random* random)
{
  Prop cone{"cone", {0.36, 0.36, 0.7}, {}};
  const Eigen::Vector3f orange = vector(0.9, 0.28, 0.06);
  cone.parts.push_back(
      part(Shape::BOX, Material::RUBBER, vector(0, 0, 0.02), vector(0.18, 0.18, 0.02), orange * 0.7f, random));
  MovingPart body = part(Shape::CAPSULE, Material::CONE, vector(0, 0, 0.37), vector(0.13, 0.13, 0.13), orange, random);
  body.primitive.length = 0.62f / 0.13f;
  body.primitive.taper = 0.2f;
  body.primitive.accent = vector(0.9, 0.9, 0.88);
  cone.parts.push_back(body);
  return cone;
}

Prop makeKerb(Random* random, const Eigen::Vector3d& size)
{
  Prop kerb{"kerb", size, {}};
  kerb.parts.push_back(part(Shape::BOX, Material::STONE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
                            grey(random, 0.55, 0.7), random));
  return kerb;
}

Prop makeCart(Random* random)
{
  Prop cart{"cart", {1.0, 0.7, 0.95}, {}};
  MovingPart base =
      part(Shape::BOX, Material::WARNING, vector(0, 0, 0.22), vector(0.5, 0.35, 0.14), vector(0.85, 0.7, 0.1), random);
  base.primitive.accent = vector(0.08, 0.08, 0.08);
  cart.parts.push_back(base);
  cart.parts.push_back(
      part(Shape::BOX, Material::CRATE, vector(0, 0, 0.66), vector(0.4, 0.3, 0.29), vector(0.62, 0.48, 0.3), random));
  return cart;
}

Prop makeBox(Random* random, double largest_m)
{
  const Eigen::Vector3d size = largest_m * random->uniform<3>({0.4, 0.4, 0.35}, {1.0, 1.0, 0.9});
  Prop box{"box", size, {}};
  const double brightness = random->uniform(0.7, 1.3);
  box.parts.push_back(part(Shape::BOX, Material::CRATE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
                           vector(0.60, 0.47, 0.30) * static_cast<float>(brightness), random));
  return box;
}

Prop makeBuilding(Random* random, const Eigen::Vector3d& size)
{
  // Brick, sandstone, plaster, concrete.
  static const float WALLS[][3] = {{0.48f, 0.27f, 0.21f}, {0.60f, 0.52f, 0.40f}, {0.72f, 0.68f, 0.60f},
                                   {0.52f, 0.52f, 0.51f}, {0.68f, 0.60f, 0.46f}, {0.40f, 0.33f, 0.29f},
                                   {0.62f, 0.45f, 0.34f}, {0.62f, 0.64f, 0.65f}};
  const float* wall = WALLS[std::min<size_t>(static_cast<size_t>(random->uniform(0.0, 8.0)), 7)];
  Prop building{"building", size, {}};
  MovingPart walls =
      part(Shape::BOX, Material::FACADE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
           Eigen::Vector3f(wall[0], wall[1], wall[2]) * static_cast<float>(random->uniform(1.2, 1.45)), random);
  walls.primitive.accent = random->chance(0.6) ? vector(0.88, 0.87, 0.84) : vector(0.25, 0.2, 0.16);
  building.parts.push_back(walls);
  return building;
}

Prop makePillar(Random* random, double height_m)
{
  Prop pillar{"pillar", {0.5, 0.5, height_m}, {}};
  const bool round = random->chance(0.5);
  pillar.parts.push_back(part(round ? Shape::CYLINDER : Shape::BOX, Material::PIPE, vector(0, 0, 0.5 * height_m),
                              vector(0.25, 0.25, 0.5 * height_m), grey(random, 0.4, 0.65), random));
  pillar.parts.back().primitive.accent = vector(0.85, 0.75, 0.15);
  MovingPart guard = part(round ? Shape::CYLINDER : Shape::BOX, Material::WARNING, vector(0, 0, 0.6),
                          vector(0.27, 0.27, 0.6), vector(0.85, 0.72, 0.1), random);
  guard.primitive.accent = vector(0.08, 0.08, 0.08);
  pillar.parts.push_back(guard);
  return pillar;
}

Prop makeShelf(Random* random, double width_m, double height_m)
{
  Prop shelf{"shelf", {width_m, 0.6, height_m}, {}};
  shelf.parts.push_back(part(Shape::BOX, Material::SHELF, vector(0, 0, 0.5 * height_m),
                             vector(0.5 * width_m, 0.3, 0.5 * height_m),
                             random->chance(0.5) ? vector(0.75, 0.35, 0.1) : vector(0.25, 0.35, 0.6), random));
  return shelf;
}

Prop makeMachine(Random* random, const Eigen::Vector3d& size)
{
  Prop machine{"machine", size, {}};
  MovingPart body = part(Shape::BOX, Material::MACHINE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
                         random->uniform<3>({0.3, 0.4, 0.3}, {0.7, 0.7, 0.6}).cast<float>(), random);
  body.primitive.accent = vector(0.92, 0.92, 0.88);
  machine.parts.push_back(body);
  if (random->chance(0.6))  // a tank or motor on top
  {
    const double radius = 0.35 * std::min(size.x(), size.y());
    machine.parts.push_back(part(Shape::CYLINDER, Material::PIPE, vector(0, 0, size.z() + 0.25),
                                 vector(radius, radius, 0.25), grey(random, 0.4, 0.7), random));
    machine.size.z() += 0.5;
  }
  return machine;
}

Prop makePoster(Random* random, double width_m, double height_m)
{
  Prop poster{"", {0.04, width_m, height_m}, {}};
  poster.parts.push_back(part(Shape::BOX, Material::POSTER, vector(0, 0, 0.5 * height_m),
                              vector(0.02, 0.5 * width_m, 0.5 * height_m), anyColor(random), random));
  poster.parts.back().primitive.accent = anyColor(random);
  return poster;
}

Prop makePipe(Random* random, double length_m, double height_m, double radius_m)
{
  Prop pipe{"pipe", {length_m, 2.0 * radius_m, height_m + radius_m}, {}};
  MovingPart tube = part(Shape::CYLINDER, Material::PIPE, vector(0, 0, height_m),
                         vector(radius_m, radius_m, 0.5 * length_m), grey(random, 0.45, 0.75), random);
  tube.primitive.rotation = Eigen::AngleAxisf(static_cast<float>(M_PI_2), Eigen::Vector3f::UnitY()).toRotationMatrix();
  tube.primitive.accent = grey(random, 0.1, 0.3);
  pipe.parts.push_back(tube);
  return pipe;
}

Prop makeHangingLamp(Random* random, double height_m)
{
  Prop lamp{"lamp", {0.5, 0.5, height_m}, {}};
  lamp.parts.push_back(part(Shape::CYLINDER, Material::METAL, vector(0, 0, height_m - 0.5), vector(0.02, 0.02, 0.5),
                            vector(0.2, 0.2, 0.2), random));
  lamp.parts.push_back(part(Shape::SPHERE, Material::LAMP, vector(0, 0, height_m - 1.0), vector(0.25, 0.25, 0.12),
                            vector(0.9, 0.9, 0.85), random));
  return lamp;
}

}  // namespace pi_simulation::synthetic
