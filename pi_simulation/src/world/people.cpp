#include "world/props.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

using Color = Eigen::Vector3f;

Color pick(Random* random, const std::vector<Color>& colors)
{
  const auto index = static_cast<size_t>(random->uniform(0.0, static_cast<double>(colors.size())));
  return colors[std::min(index, colors.size() - 1)] * static_cast<float>(random->uniform(0.6, 0.95));
}

const std::vector<Color> SKINS = {{0.87f, 0.67f, 0.56f}, {0.78f, 0.58f, 0.46f}, {0.62f, 0.43f, 0.31f},
                                  {0.42f, 0.27f, 0.19f}, {0.28f, 0.18f, 0.13f}, {0.90f, 0.72f, 0.62f}};
const std::vector<Color> HAIRS = {{0.06f, 0.05f, 0.04f}, {0.14f, 0.09f, 0.06f}, {0.25f, 0.16f, 0.09f},
                                  {0.45f, 0.33f, 0.18f}, {0.42f, 0.41f, 0.40f}, {0.32f, 0.14f, 0.06f}};
const std::vector<Color> TROUSERS = {{0.12f, 0.16f, 0.28f}, {0.18f, 0.24f, 0.38f}, {0.07f, 0.07f, 0.08f},
                                     {0.20f, 0.20f, 0.21f}, {0.34f, 0.30f, 0.24f}, {0.05f, 0.05f, 0.06f},
                                     {0.28f, 0.34f, 0.46f}, {0.10f, 0.10f, 0.14f}};
const std::vector<Color> TOPS = {{0.75f, 0.75f, 0.73f}, {0.08f, 0.08f, 0.10f}, {0.55f, 0.10f, 0.10f},
                                 {0.12f, 0.22f, 0.48f}, {0.35f, 0.36f, 0.38f}, {0.14f, 0.34f, 0.20f},
                                 {0.78f, 0.62f, 0.14f}, {0.48f, 0.30f, 0.46f}, {0.92f, 0.92f, 0.90f},
                                 {0.20f, 0.45f, 0.55f}, {0.80f, 0.38f, 0.14f}, {0.10f, 0.12f, 0.20f}};
const std::vector<Color> SHOES = {
    {0.05f, 0.05f, 0.05f}, {0.80f, 0.80f, 0.78f}, {0.22f, 0.13f, 0.08f}, {0.35f, 0.36f, 0.40f}};

/// Two balls of different size, and the smooth hull around them.
struct Limb
{
  Eigen::Vector3d from;
  Eigen::Vector3d to;
  double from_radius;  ///< [m]
  double to_radius;
  double flat = 1.0;  ///< thickness along x in parts of that along y
};

/// What a person wears and how wide the person is.
struct Look
{
  Color skin;
  Color hair;
  Color top;
  Color trousers;
  Color shoes;
  double girth;     ///< 1: slim
  double shoulder;  ///< 1: usual
  bool child;
  bool long_hair;
  bool bald;
  bool cap;
  bool short_sleeves;
  bool shorts;
  bool skirt;
  bool coat;
  bool backpack;
};

/// Collects the parts of a person; lengths are for one of 1.75 m.
class Tailor
{
public:
  Tailor(double scale, Random* random, std::vector<MovingPart>* parts) : scale_(scale), random_(random), parts_(parts)
  {
  }

  void limb(Bone bone, Material material, const Limb& limb, const Color& color)
  {
    const Eigen::Vector3d way = limb.to - limb.from;
    const double length = std::max(way.norm(), 1e-4);
    const Eigen::Vector3d z = way / length;
    // x of the shape stays as near to forward as it can: fronts of clothes are there.
    const Eigen::Vector3d ahead =
        std::abs(z.x()) > 0.9 ? Eigen::Vector3d(-z.z(), 0.0, z.x()) : Eigen::Vector3d::UnitX();
    const Eigen::Vector3d y = z.cross(ahead).normalized();
    MovingPart part = make(bone, Shape::CAPSULE, material, 0.5 * (limb.from + limb.to), color);
    part.primitive.rotation.col(0) = y.cross(z).cast<float>();
    part.primitive.rotation.col(1) = y.cast<float>();
    part.primitive.rotation.col(2) = z.cast<float>();
    part.primitive.half = (scale_ * limb.from_radius * Eigen::Vector3d(limb.flat, 1.0, 1.0)).cast<float>();
    part.primitive.length = static_cast<float>(length / limb.from_radius);
    part.primitive.taper = static_cast<float>(limb.to_radius / limb.from_radius);
    parts_->push_back(part);
  }

  void ball(Bone bone, Material material, const Eigen::Vector3d& center, const Eigen::Vector3d& half,
            const Color& color)
  {
    MovingPart part = make(bone, Shape::SPHERE, material, center, color);
    part.primitive.half = (scale_ * half).cast<float>();
    parts_->push_back(part);
  }

  MovingPart& last() { return parts_->back(); }

private:
  MovingPart make(Bone bone, Shape shape, Material material, const Eigen::Vector3d& center, const Color& color)
  {
    MovingPart part;
    part.bone = bone;
    part.primitive.shape = shape;
    part.primitive.material = material;
    part.primitive.center = (scale_ * center).cast<float>();
    part.primitive.color = color;
    part.primitive.accent = color;
    part.primitive.seed = random_->seed();
    return part;
  }

  const double scale_;
  Random* random_;
  std::vector<MovingPart>* parts_;
};

Look randomLook(Random* random, bool child)
{
  Look look;
  look.skin = pick(random, SKINS);
  look.hair = pick(random, HAIRS);
  look.top = pick(random, TOPS);
  look.trousers = pick(random, TROUSERS);
  look.shoes = pick(random, SHOES);
  look.girth = random->uniform(1.05, 1.35);
  look.shoulder = random->uniform(0.88, 1.05);
  look.child = child;
  look.long_hair = random->chance(0.4);
  look.bald = !child && !look.long_hair && random->chance(0.15);
  look.cap = random->chance(0.12);
  look.short_sleeves = random->chance(0.4);
  look.shorts = random->chance(child ? 0.4 : 0.15);
  look.skirt = !look.shorts && look.long_hair && random->chance(0.3);
  look.coat = !look.short_sleeves && random->chance(0.25);
  look.backpack = random->chance(0.25);
  return look;
}

void addHead(const Look& look, Random* random, Tailor* tailor)
{
  const double grown = look.child ? 1.22 : 1.07;  // a child's head is large
  const auto h = [&](double x, double y, double z) { return Eigen::Vector3d(grown * x, grown * y, grown * z); };
  tailor->limb(Bone::HEAD, Material::SKIN, {{-0.015, 0.0, -0.09}, {0.0, 0.0, 0.0}, 0.056, 0.052}, look.skin);
  tailor->ball(Bone::HEAD, Material::FACE, h(0.012, 0.0, 0.105), h(0.094, 0.078, 0.118), look.skin);
  tailor->last().primitive.accent = look.hair;
  tailor->limb(Bone::HEAD, Material::SKIN, {h(0.03, 0.0, 0.03), h(0.055, 0.0, 0.025), 0.05 * grown, 0.034 * grown},
               look.skin);
  tailor->limb(Bone::HEAD, Material::SKIN, {h(0.1, 0.0, 0.11), h(0.112, 0.0, 0.085), 0.01, 0.016}, look.skin);
  for (const double side : {1.0, -1.0})
  {
    tailor->ball(Bone::HEAD, Material::SKIN, h(0.0, 0.08 * side, 0.095), h(0.022, 0.012, 0.034), look.skin);
  }
  if (!look.bald)
  {
    const double volume = random->uniform(1.0, 1.1);
    tailor->ball(Bone::HEAD, Material::HAIR, h(-0.018, 0.0, 0.132), h(0.1, 0.088 * volume, 0.106 * volume), look.hair);
  }
  if (look.long_hair)
  {
    const double length = random->uniform(0.06, 0.2);
    tailor->limb(Bone::HEAD, Material::HAIR, {h(-0.035, 0.0, 0.1), h(-0.06, 0.0, -length), 0.092, 0.075, 0.62},
                 look.hair);
  }
  if (look.cap)
  {
    const Color cap = pick(random, TOPS);
    tailor->ball(Bone::HEAD, Material::CLOTH, h(-0.002, 0.0, 0.15), h(0.108, 0.096, 0.09), cap);
    tailor->limb(Bone::HEAD, Material::CLOTH, {h(0.07, 0.0, 0.165), h(0.13, 0.0, 0.15), 0.06, 0.05, 0.15}, cap);
  }
}

void addTrunk(const Look& look, Random* random, Tailor* tailor)
{
  const double g = look.girth;
  const double s = look.shoulder;
  const Material top = look.coat ? Material::JACKET : Material::SHIRT;
  const double puff = look.coat ? 1.1 : 1.0;
  // Waist to chest, then the slope of the shoulders.
  tailor->limb(Bone::CHEST, top, {{0.0, 0.0, -0.05}, {0.0, 0.0, 0.17}, 0.138 * g * puff, 0.16 * s * puff, 0.72},
               look.top);
  const Color accent = pick(random, TOPS);
  tailor->last().primitive.accent = accent;
  for (const double side : {1.0, -1.0})
  {
    tailor->limb(Bone::CHEST, top,
                 {{-0.01, 0.03 * side, 0.3}, {-0.01, 0.165 * s * side, 0.3}, 0.07 * puff, 0.058 * puff, 0.95},
                 look.top);
    tailor->limb(Bone::CHEST, top,
                 {{0.0, 0.09 * s * side, 0.2}, {-0.005, 0.1 * s * side, 0.27}, 0.1 * puff, 0.08 * puff, 0.95},
                 look.top);
  }
  tailor->limb(Bone::CHEST, top, {{-0.01, 0.0, 0.29}, {-0.01, 0.0, 0.375}, 0.09, 0.055, 0.95}, look.top);
  if (g > 1.15)  // a belly
  {
    tailor->ball(Bone::CHEST, top, {0.03 * g, 0.0, -0.02}, {0.11 * g, 0.14 * g, 0.14}, look.top);
  }
  const bool untucked = look.coat || random->chance(0.6);
  const double hem = look.coat ? -0.12 : 0.03;
  tailor->limb(Bone::PELVIS, untucked ? top : Material::TROUSERS,
               {{0.0, 0.0, 0.12}, {0.0, 0.0, hem}, 0.138 * g * puff, 0.15 * g * puff, 0.74},
               untucked ? look.top : look.trousers);
  if (untucked)
  {
    tailor->last().primitive.accent = accent;
  }
  tailor->limb(Bone::PELVIS, Material::TROUSERS, {{-0.015, 0.06, -0.02}, {-0.015, -0.06, -0.02}, 0.11 * g, 0.11 * g},
               look.trousers);
  if (look.skirt)
  {
    tailor->limb(Bone::PELVIS, Material::SKIRT, {{0.0, 0.0, 0.05}, {0.0, 0.0, -0.34}, 0.145 * g, 0.19, 0.8},
                 look.trousers);
  }
  if (look.backpack)
  {
    const Color bag = pick(random, TOPS);
    tailor->limb(Bone::CHEST, Material::JACKET, {{-0.2, 0.0, 0.02}, {-0.18, 0.0, 0.26}, 0.15, 0.13, 0.7}, bag);
    for (const double side : {1.0, -1.0})
    {
      tailor->limb(Bone::CHEST, Material::JACKET,
                   {{0.105, 0.09 * side, 0.12}, {0.03, 0.1 * side, 0.385}, 0.022, 0.026, 0.8}, bag);
    }
  }
}

void addLimbs(const Look& look, const Figure& figure, Tailor* tailor)
{
  const double g = 0.5 + 0.5 * look.girth;
  const double puff = look.coat ? 1.22 : 1.0;
  const Material top = Material::SLEEVE;
  const double upper = figure.upper_arm;
  const double lower = figure.forearm;
  for (const int side : {0, 1})
  {
    const double left = side == 0 ? 1.0 : -1.0;
    const auto of = [&](Bone bone) { return side == 0 ? bone : rightOf(bone); };
    const Bone arm = of(Bone::LEFT_UPPER_ARM);
    const Bone forearm = of(Bone::LEFT_FOREARM);
    const Bone thigh = of(Bone::LEFT_THIGH);
    const Bone shin = of(Bone::LEFT_SHIN);
    const Bone foot = of(Bone::LEFT_FOOT);
    const Color& bare = look.skin;
    if (look.short_sleeves)
    {
      tailor->limb(arm, top, {{0.0, 0.0, -0.02}, {0.0, 0.0, -0.6 * upper}, 0.056 * g, 0.057 * g}, look.top);
      tailor->limb(arm, Material::SKIN, {{0.0, 0.0, -0.4 * upper}, {0.0, 0.0, -upper}, 0.046 * g, 0.039 * g}, bare);
      tailor->limb(forearm, Material::SKIN, {{0.0, 0.0, 0.0}, {0.0, 0.0, -lower}, 0.041 * g, 0.028}, bare);
    }
    else
    {
      tailor->limb(arm, top, {{0.0, 0.0, -0.02}, {0.0, 0.0, -upper}, 0.056 * g * puff, 0.046 * g * puff}, look.top);
      tailor->limb(forearm, top, {{0.0, 0.0, 0.0}, {0.0, 0.0, -0.94 * lower}, 0.048 * g * puff, 0.036 * puff},
                   look.top);
    }
    tailor->limb(forearm, Material::SKIN, {{0.0, 0.0, -lower}, {0.015, 0.0, -lower - 0.09}, 0.032, 0.034, 1.0}, bare);
    tailor->last().primitive.half.y() *= 0.6f;
    tailor->limb(forearm, Material::SKIN,
                 {{0.015, 0.0, -lower - 0.09}, {0.02, -0.012 * left, -lower - 0.15}, 0.028, 0.02, 1.0}, bare);
    tailor->last().primitive.half.y() *= 0.6f;
    tailor->limb(forearm, Material::SKIN,
                 {{0.02, 0.0, -lower - 0.03}, {0.05, -0.01 * left, -lower - 0.085}, 0.015, 0.011}, bare);

    const Material legs = look.shorts || look.skirt ? Material::SKIN : Material::TROUSERS;
    const Color& leg_color = legs == Material::SKIN ? look.skin : look.trousers;
    const double loose = legs == Material::SKIN ? 0.9 : 1.06;
    if (look.shorts)
    {
      tailor->limb(thigh, Material::TROUSERS,
                   {{0.0, 0.0, -0.02}, {0.0, 0.0, -0.75 * figure.thigh}, 0.098 * g, 0.09 * g}, look.trousers);
    }
    tailor->limb(thigh, legs, {{-0.005, 0.0, -0.02}, {0.0, 0.0, -figure.thigh}, 0.096 * g * loose, 0.062 * g * loose},
                 leg_color);
    // The calf is behind the bone; trousers fall straight.
    tailor->limb(shin, legs,
                 {{-0.012, 0.0, -0.02}, {-0.012, 0.0, -0.5 * figure.shin}, 0.059 * g * loose, 0.056 * g * loose},
                 leg_color);
    tailor->limb(shin, legs,
                 {{-0.012, 0.0, -0.42 * figure.shin},
                  {0.0, 0.0, -figure.shin + 0.03},
                  0.057 * g * loose,
                  legs == Material::SKIN ? 0.036 : 0.054},
                 leg_color);
    tailor->limb(shin, Material::SKIN, {{0.0, 0.0, -0.9 * figure.shin}, {0.0, 0.0, -figure.shin}, 0.036, 0.038}, bare);
    tailor->limb(foot, Material::SHOE, {{-0.055, 0.0, -0.035}, {0.12, 0.008 * left, -0.048}, 0.045, 0.034}, look.shoes);
    tailor->last().primitive.half.y() *= 0.98f;
    tailor->limb(foot, Material::SHOE, {{-0.03, 0.0, 0.0}, {0.05, 0.0, -0.025}, 0.044, 0.04}, look.shoes);
  }
}

Figure figureOf(const Look& look, Random* random)
{
  Figure figure;
  if (look.child)  // short legs, a large head
  {
    figure.thigh *= 0.92;
    figure.shin *= 0.92;
  }
  figure.shoulder *= look.shoulder;
  figure.arms_aside = random->uniform(0.07, 0.16);
  return figure;
}

constexpr double USUAL_M = 1.75;
constexpr double CHILD_M = 1.4;  ///< smaller people look like children

}  // namespace

Prop makePerson(Random* random, double height_m)
{
  const double height = height_m > 0.0 ? height_m : random->uniform(1.55, 1.9);
  const double scale = height / USUAL_M;
  const Look look = randomLook(random, height < CHILD_M);
  const Figure figure = figureOf(look, random);
  Prop person{"person", {0.5, 0.6, height}, {}, figure.scaled(scale)};
  if (look.child)
  {
    person.size.head<2>() *= scale;
  }
  Tailor tailor(scale, random, &person.parts);
  addTrunk(look, random, &tailor);
  addLimbs(look, figure, &tailor);
  addHead(look, random, &tailor);
  return person;
}

namespace
{

void addBicycle(const Figure& figure, Random* random, Tailor* tailor)
{
  const Color paint = pick(random, TOPS);
  const Color black(0.05f, 0.05f, 0.05f);
  const Color steel(0.55f, 0.56f, 0.58f);
  const double half = 0.5 * figure.wheel_base;
  const double r = figure.wheel;
  const Eigen::Vector3d rear(-half, 0.0, r);
  const Eigen::Vector3d front(half, 0.0, r);
  const Eigen::Vector3d bracket(0.0, 0.0, 0.28);
  const Eigen::Vector3d seat(-0.2, 0.0, 0.82);
  const Eigen::Vector3d head(0.36, 0.0, 0.78);
  const auto tube = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius, const Color& color) {
    tailor->limb(Bone::ROOT, Material::TUBE, {a, b, radius, radius}, color);
  };
  tube(bracket, seat, 0.018, paint);
  tube(bracket, head, 0.02, paint);
  tube(seat, head, 0.018, paint);
  tube(head, head + Eigen::Vector3d(-0.04, 0.0, 0.2), 0.016, steel);
  for (const double side : {1.0, -1.0})
  {
    const Eigen::Vector3d out(0.0, 0.05 * side, 0.0);
    tube(rear + out, bracket + 0.4 * out, 0.01, paint);
    tube(rear + out, seat + 0.2 * out, 0.01, paint);
    tube(front + out, head, 0.013, paint);
    tube({0.32, 0.0, 0.99}, {0.34, 0.24 * side, 1.02}, 0.012, steel);
    tube({0.34, 0.24 * side, 1.02}, {0.26, 0.3 * side, 1.01}, 0.016, black);
    const double angle = side > 0.0 ? 0.0 : M_PI;
    const Eigen::Vector3d pedal(0.17 * std::cos(angle), 0.1 * side, 0.0);
    tailor->limb(Bone::CRANK, Material::TUBE, {{0.0, 0.07 * side, 0.0}, pedal, 0.012, 0.012}, steel);
    tailor->limb(Bone::CRANK, Material::RUBBER, {pedal, pedal + Eigen::Vector3d(0.0, 0.09 * side, 0.0), 0.018, 0.018},
                 black);
  }
  tailor->limb(Bone::ROOT, Material::RUBBER, {{-0.32, 0.0, 0.86}, {-0.1, 0.0, 0.87}, 0.075, 0.03}, black);
  tailor->last().primitive.half.x() *= 0.5f;
  for (const Bone wheel : {Bone::REAR_WHEEL, Bone::FRONT_WHEEL})
  {
    tailor->ball(wheel, Material::RUBBER, Eigen::Vector3d::Zero(), {r, r, 0.02}, black);
    tailor->last().primitive.shape = Shape::RING;
    tailor->last().primitive.taper = 0.9f;
    tailor->last().primitive.rotation =
        Eigen::AngleAxisf(static_cast<float>(M_PI_2), Eigen::Vector3f::UnitX()).toRotationMatrix();
    for (int i = 0; i < 6; ++i)  // spokes
    {
      const double angle = i * M_PI / 6.0;
      const Eigen::Vector3d end(0.9 * r * std::cos(angle), 0.0, 0.9 * r * std::sin(angle));
      tailor->limb(wheel, Material::TUBE, {-end, end, 0.003, 0.003}, steel);
    }
  }
}

}  // namespace

Prop makeCyclist(Random* random)
{
  Look look = randomLook(random, false);
  look.skirt = false;
  look.coat = false;
  Figure figure = figureOf(look, random);
  figure.rides = true;
  Prop cyclist{"cyclist", {1.75, 0.6, 1.72}, {}, figure};
  Tailor tailor(1.0, random, &cyclist.parts);
  addTrunk(look, random, &tailor);
  addLimbs(look, figure, &tailor);
  addHead(look, random, &tailor);
  if (random->chance(0.5))  // a helmet
  {
    tailor.ball(Bone::HEAD, Material::TUBE, {-0.01, 0.0, 0.16}, {0.13, 0.105, 0.09}, pick(random, TOPS));
  }
  addBicycle(figure, random, &tailor);
  return cyclist;
}

}  // namespace pi_simulation::synthetic
