#include "renderer/props.h"

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
  return vector(random->uniform(0.1, 0.85), random->uniform(0.1, 0.85), random->uniform(0.1, 0.85));
}

MovingPart limb(Material material, double y, double low, double high, double thickness, double swing,
                const Eigen::Vector3f& color, Random* random)
{
  MovingPart result = part(Shape::BOX, material, vector(0.0, y, 0.5 * (low + high)),
                           vector(thickness, thickness, 0.5 * (high - low)), color, random);
  result.swing = static_cast<float>(swing);
  result.pivot_z = static_cast<float>(high);
  return result;
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
  const Eigen::Vector3f green =
      vector(random->uniform(0.25, 0.45), random->uniform(0.45, 0.65), random->uniform(0.15, 0.25));
  for (int i = 0; i < 9; ++i)
  {
    const double size = random->uniform(0.5, 0.9);
    tree.parts.push_back(
        part(Shape::SPHERE, Material::FOLIAGE,
             vector(random->uniform(-0.7, 0.7), random->uniform(-0.7, 0.7), trunk + 0.5 + random->uniform(0.0, 1.5)),
             vector(size, size, 0.8 * size), green, random));
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
  MovingPart board =
      part(Shape::BOX, Material::SIGN, vector(0, 0, 2.2),
           vector(0.02, random->uniform(0.3, 0.45), random->uniform(0.25, 0.45)), anyColor(random), random);
  board.primitive.accent = board.primitive.color.sum() > 1.5f ? vector(0.08, 0.08, 0.1) : vector(0.92, 0.92, 0.9);
  sign.parts.push_back(board);
  return sign;
}

Prop makeCar(Random* random)
{
  Prop car{"car", {4.2, 1.76, 1.52}, {}};
  const Eigen::Vector3f color = anyColor(random);
  MovingPart body = part(Shape::BOX, Material::CAR_PAINT, vector(0, 0, 0.6), vector(2.1, 0.86, 0.36), color, random);
  body.primitive.accent = vector(0.95, 0.9, 0.8);
  car.parts.push_back(body);
  car.parts.push_back(
      part(Shape::BOX, Material::GLASS, vector(-0.25, 0, 1.24), vector(1.15, 0.76, 0.28), color, random));
  for (const double x : {-1.3, 1.3})
  {
    for (const double y : {-0.77, 0.77})
    {
      MovingPart wheel = part(Shape::CYLINDER, Material::RUBBER, vector(x, y, 0.32), vector(0.32, 0.32, 0.11),
                              vector(0.1, 0.1, 0.1), random);
      wheel.primitive.rotation =
          Eigen::AngleAxisf(static_cast<float>(M_PI_2), Eigen::Vector3f::UnitX()).toRotationMatrix();
      car.parts.push_back(wheel);
    }
  }
  return car;
}

Prop makePerson(Random* random)
{
  constexpr double SWING = 0.5;  // [rad]
  Prop person{"person", {0.5, 0.6, 1.77}, {}};
  const Eigen::Vector3f trousers = anyColor(random) * 0.5f;
  const Eigen::Vector3f shirt = anyColor(random);
  const Eigen::Vector3f skin = vector(0.75, 0.58, 0.48) * static_cast<float>(random->uniform(0.4, 1.1));
  for (const double side : {-1.0, 1.0})
  {
    person.parts.push_back(limb(Material::CLOTH, 0.1 * side, 0.02, 0.87, 0.075, SWING * side, trousers, random));
    person.parts.push_back(limb(Material::CLOTH, 0.26 * side, 0.85, 1.45, 0.05, -SWING * side, shirt, random));
  }
  person.parts.push_back(
      part(Shape::SPHERE, Material::CLOTH, vector(0, 0, 1.17), vector(0.15, 0.23, 0.38), shirt, random));
  person.parts.push_back(
      part(Shape::SPHERE, Material::SKIN, vector(0, 0, 1.64), vector(0.1, 0.09, 0.13), skin, random));
  return person;
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
  const Eigen::Vector3d size(random->uniform(0.4, 1.0) * largest_m, random->uniform(0.4, 1.0) * largest_m,
                             random->uniform(0.35, 0.9) * largest_m);
  Prop box{"box", size, {}};
  const double brightness = random->uniform(0.7, 1.3);
  box.parts.push_back(part(Shape::BOX, Material::CRATE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
                           vector(0.60, 0.47, 0.30) * static_cast<float>(brightness), random));
  return box;
}

Prop makeBuilding(Random* random, const Eigen::Vector3d& size)
{
  Prop building{"building", size, {}};
  MovingPart walls =
      part(Shape::BOX, Material::FACADE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
           vector(random->uniform(0.4, 0.75), random->uniform(0.35, 0.6), random->uniform(0.3, 0.55)), random);
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
  MovingPart body =
      part(Shape::BOX, Material::MACHINE, vector(0, 0, 0.5 * size.z()), (0.5 * size).cast<float>(),
           vector(random->uniform(0.3, 0.7), random->uniform(0.4, 0.7), random->uniform(0.3, 0.6)), random);
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
