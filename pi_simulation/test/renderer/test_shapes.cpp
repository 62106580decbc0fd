// Shapes of the scene against what a point inside of them is, step by step along rays; shadows against rays to the sun.

#include "renderer/ray_packet.h"
#include "renderer/scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

using namespace pi_simulation::synthetic;

struct ShapeCase
{
  const char* name;
  Shape shape;
  float length;
  float taper;
  float rear;
  float sides;
};

class Shapes : public testing::TestWithParam<ShapeCase>
{
};

namespace
{

bool insideCapsule(const ShapeCase& c, const Eigen::Vector3f& p)
{
  for (int i = 0; i <= 400; ++i)
  {
    const float s = static_cast<float>(i) / 400.0f;
    const Eigen::Vector3f center(0.0f, 0.0f, (s - 0.5f) * c.length);
    if ((p - center).norm() <= 1.0f + s * (c.taper - 1.0f))
    {
      return true;
    }
  }
  return false;
}

/// Of a point in the unit frame.
bool inside(const ShapeCase& c, const Eigen::Vector3f& p)
{
  const float up = 0.5f * (p.z() + 1.0f);
  switch (c.shape)
  {
    case Shape::CAPSULE:
      return insideCapsule(c, p);
    case Shape::WEDGE:
      return std::abs(p.z()) <= 1.0f && p.x() <= 1.0f - c.taper * up && p.x() >= c.rear * up - 1.0f &&
             std::abs(p.y()) <= 1.0f - c.sides * up;
    case Shape::RING:
      return std::abs(p.z()) <= 1.0f && p.head<2>().norm() <= 1.0f && p.head<2>().norm() >= c.taper;
    case Shape::SPHERE:
      return p.norm() <= 1.0f;
    case Shape::CYLINDER:
      return std::abs(p.z()) <= 1.0f && p.head<2>().norm() <= 1.0f;
    default:
      return p.cwiseAbs().maxCoeff() <= 1.0f;
  }
}

Primitive primitiveOf(const ShapeCase& c)
{
  Primitive primitive;
  primitive.shape = c.shape;
  primitive.length = c.length;
  primitive.taper = c.taper;
  primitive.rear = c.rear;
  primitive.sides = c.sides;
  primitive.center = {1.0f, 2.0f, 3.0f};
  // A ring is thin, and its sun must not come along it.
  primitive.half = c.shape == Shape::RING ? Eigen::Vector3f(0.6f, 0.6f, 0.01f) : Eigen::Vector3f(0.5f, 0.7f, 0.6f);
  primitive.rotation = Eigen::AngleAxisf(0.6f, Eigen::Vector3f(0.3f, 0.9f, 0.2f).normalized()).toRotationMatrix();
  primitive.object = 7;
  return primitive;
}

Scene sceneOf(const ShapeCase& c)
{
  Scene scene;
  scene.primitives.push_back(primitiveOf(c));
  scene.finish();
  return scene;
}

/// A cone that nothing is beside.
Frustum everything(const Eigen::Vector3f& origin)
{
  FrustumNormals normals;
  normals.fill(Eigen::Vector3f::Zero());
  return {normals, Eigen::Matrix3f::Identity(), origin};
}

}  // namespace

TEST_P(Shapes, RaysEndWhereTheInsideBegins)
{
  constexpr float STEP = 0.002f;
  const ShapeCase& c = GetParam();
  const Scene scene = sceneOf(c);
  const Primitive& primitive = scene.primitives.front();
  std::mt19937 random(3);
  std::uniform_real_distribution<float> anywhere(-1.0f, 1.0f);
  int hits = 0;
  int wrong = 0;
  for (int round = 0; round < 10; ++round)
  {
    RayPacket packet;
    packet.origin = primitive.center +
                    4.0f * Eigen::Vector3f(anywhere(random), anywhere(random), anywhere(random) + 1.5f).normalized();
    for (int i = 0; i < LANES; ++i)
    {
      const Eigen::Vector3f aim =
          primitive.center + Eigen::Vector3f(anywhere(random), anywhere(random), anywhere(random));
      const Eigen::Vector3f d = (aim - packet.origin).normalized();
      packet.dx[i] = d.x();
      packet.dy[i] = d.y();
      packet.dz[i] = d.z();
      packet.spread[i] = 1e-3f;
    }
    Candidates candidates;
    candidates.find(scene, {}, everything(packet.origin));
    trace(scene, candidates, everything(packet.origin), &packet);
    for (int i = 0; i < LANES; ++i)
    {
      const Eigen::Vector3f d(packet.dx[i], packet.dy[i], packet.dz[i]);
      float begins = RayPacket::FAR_M;
      for (float t = 1.0f; t < 7.0f && begins == RayPacket::FAR_M; t += STEP)
      {
        const Eigen::Vector3f point = packet.origin + t * d;
        begins = inside(c, primitive.to_unit * (point - primitive.center)) ? t : begins;
      }
      hits += begins < RayPacket::FAR_M;
      // A ray that grazes an edge, or the inner wall of a ring, may differ.
      wrong += std::abs(begins - packet.t[i]) > 2.0f * STEP;
    }
  }
  EXPECT_GT(hits, 60) << c.name;
  EXPECT_LE(wrong, 640 / 50) << c.name << ", of 640 rays, " << hits << " hit";
}

TEST_P(Shapes, AShadowIsWhereTheRayToTheSunHits)
{
  const ShapeCase& c = GetParam();
  const Scene scene = sceneOf(c);
  const Primitive& primitive = scene.primitives.front();
  std::mt19937 random(4);
  std::uniform_real_distribution<float> anywhere(-1.5f, 1.5f);
  // Below the middle of the shape, seen from the sun.
  const Eigen::Vector3f foot = primitive.center - primitive.center.z() / scene.sun.z() * scene.sun;
  alignas(64) float u[LANES];
  alignas(64) float v[LANES];
  alignas(64) float light[LANES];
  int dark = 0;
  int wrong = 0;
  for (int round = 0; round < 10; ++round)
  {
    for (int i = 0; i < LANES; ++i)
    {
      u[i] = foot.x() + anywhere(random);
      v[i] = foot.y() + anywhere(random);
      light[i] = 1.0f;
    }
    scene.shadows.cast(&primitive, u, v, LANES, 0.25f, light);
    for (int i = 0; i < LANES; ++i)
    {
      RayPacket packet;
      packet.origin = {u[i], v[i], 0.0f};
      std::fill(packet.dx, packet.dx + LANES, scene.sun.x());
      std::fill(packet.dy, packet.dy + LANES, scene.sun.y());
      std::fill(packet.dz, packet.dz + LANES, scene.sun.z());
      std::fill(packet.spread, packet.spread + LANES, 1e-3f);
      Candidates candidates;
      candidates.find(scene, {}, everything(packet.origin));
      trace(scene, candidates, everything(packet.origin), &packet);
      const bool hidden = packet.hit[0] != RayPacket::SKY;
      dark += hidden;
      EXPECT_TRUE(light[i] == 0.25f || light[i] == 1.0f);
      wrong += hidden != (light[i] == 0.25f);
    }
  }
  EXPECT_GT(dark, 30) << c.name;
  EXPECT_LE(wrong, 640 / 100) << c.name << ", of 640 points, " << dark << " in the shadow";
}

TEST_P(Shapes, ASilhouetteIsWhatAnObjectCoversAlone)
{
  const ShapeCase& c = GetParam();
  Scene scene = sceneOf(c);
  Primitive screen = primitiveOf({"screen", Shape::BOX, 0.0f, 0.0f, 0.0f, 0.0f});
  screen.center = {1.0f, 2.0f, 6.0f};
  screen.half = {5.0f, 5.0f, 0.1f};
  screen.rotation.setIdentity();
  screen.object = 8;
  scene.primitives.push_back(screen);
  scene.finish();
  RayPacket packet;
  packet.origin = {1.0f, 2.0f, 9.0f};
  std::fill(packet.dx, packet.dx + LANES, 0.0f);
  std::fill(packet.dy, packet.dy + LANES, 0.0f);
  std::fill(packet.dz, packet.dz + LANES, -1.0f);
  packet.dx[0] = 1.0f;  // beside both
  packet.dz[0] = 0.0f;
  std::fill(packet.spread, packet.spread + LANES, 1e-3f);
  Candidates candidates;
  candidates.find(scene, {}, everything(packet.origin));
  trace(scene, candidates, everything(packet.origin), &packet);
  EXPECT_EQ(scene.primitives[static_cast<size_t>(packet.hit[5])].object, 8) << "the screen is in front";
  const bool through_the_hole = c.shape == Shape::RING;
  EXPECT_EQ(silhouette(candidates, everything(packet.origin), 7, &packet), through_the_hole ? 0 : ~uint64_t{1});
  EXPECT_EQ(silhouette(candidates, everything(packet.origin), 8, &packet), ~uint64_t{1});
  EXPECT_EQ(silhouette(candidates, everything(packet.origin), 9, &packet), uint64_t{0});
}

INSTANTIATE_TEST_SUITE_P(All, Shapes,
                         testing::Values(ShapeCase{"ball", Shape::SPHERE, 0.0f, 0.0f, 0.0f, 0.0f},
                                         ShapeCase{"box", Shape::BOX, 0.0f, 0.0f, 0.0f, 0.0f},
                                         ShapeCase{"cylinder", Shape::CYLINDER, 0.0f, 0.0f, 0.0f, 0.0f},
                                         ShapeCase{"limb", Shape::CAPSULE, 2.0f, 0.6f, 0.0f, 0.0f},
                                         ShapeCase{"thick_end", Shape::CAPSULE, 1.5f, 1.4f, 0.0f, 0.0f},
                                         ShapeCase{"wedge", Shape::WEDGE, 0.0f, 0.5f, 0.3f, 0.2f},
                                         ShapeCase{"ring", Shape::RING, 0.0f, 0.7f, 0.0f, 0.0f}),
                         [](const testing::TestParamInfo<ShapeCase>& info) { return info.param.name; });
