#include "renderer/shadow.h"

#include "renderer/scene.h"
#include "renderer/texture.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

/// Points on the ground in the unit frame of a primitive, and the way to the sun, which is the same for all.
struct alignas(64) SunRays
{
  int n;
  float x[LANES];
  float y[LANES];
  float z[LANES];
  Eigen::Vector3f d;
};

PI_SIMULATION_VECTORISED void toUnit(const Primitive& p, const float* u, const float* v, float ground_z, int n,
                                     const Eigen::Vector3f& sun, SunRays* rays)
{
  const Eigen::Matrix3f& m = p.to_unit;
  const Eigen::Vector3f offset = m * (Eigen::Vector3f(0.0f, 0.0f, ground_z) - p.center);
  const float ox = offset.x();
  const float oy = offset.y();
  const float oz = offset.z();
  const float m00 = m(0, 0), m01 = m(0, 1);
  const float m10 = m(1, 0), m11 = m(1, 1);
  const float m20 = m(2, 0), m21 = m(2, 1);
  rays->n = n;
  rays->d = m * sun;
  for (int i = 0; i < n; ++i)
  {
    rays->x[i] = ox + m00 * u[i] + m01 * v[i];
    rays->y[i] = oy + m10 * u[i] + m11 * v[i];
    rays->z[i] = oz + m20 * u[i] + m21 * v[i];
  }
}

/// Darkens the points whose rays meet a ball at height z of the unit frame.
PI_SIMULATION_VECTORISED void castBall(const SunRays& rays, float z, float radius, float dark, float* light)
{
  const float dx = rays.d.x();
  const float dy = rays.d.y();
  const float dz = rays.d.z();
  const float a = dx * dx + dy * dy + dz * dz;
  for (int i = 0; i < rays.n; ++i)
  {
    const float oz = rays.z[i] - z;
    const float b = rays.x[i] * dx + rays.y[i] * dy + oz * dz;
    const float c = rays.x[i] * rays.x[i] + rays.y[i] * rays.y[i] + oz * oz - radius * radius;
    light[i] = b * b - a * c > 0.0f ? dark : light[i];
  }
}

PI_SIMULATION_VECTORISED void castCylinder(const SunRays& rays, float dark, float* light)
{
  const float dx = rays.d.x();
  const float dy = rays.d.y();
  const float a = std::max(dx * dx + dy * dy, 1e-12f);
  const float iz = 1.0f / rays.d.z();
  for (int i = 0; i < rays.n; ++i)
  {
    const float b = rays.x[i] * dx + rays.y[i] * dy;
    const float root = b * b - a * (rays.x[i] * rays.x[i] + rays.y[i] * rays.y[i] - 1.0f);
    const float reach = std::sqrt(std::max(root, 0.0f));
    const float z1 = (-1.0f - rays.z[i]) * iz;
    const float z2 = (1.0f - rays.z[i]) * iz;
    const float enter = std::max((-b - reach) / a, std::min(z1, z2));
    const float leave = std::min((-b + reach) / a, std::max(z1, z2));
    light[i] = (root > 0.0f) & (enter < leave) ? dark : light[i];
  }
}

PI_SIMULATION_VECTORISED void castSide(const SunRays& rays, float length, float taper, float dark, float* light)
{
  const float dx = rays.d.x();
  const float dy = rays.d.y();
  const float dz = rays.d.z();
  const float thinner = 1.0f - taper;
  const float l2 = length * length;
  const float cone = l2 - thinner * thinner;
  const float m2 = length * dz;
  const float k2 = cone * (dx * dx + dy * dy + dz * dz) - m2 * m2;
  for (int i = 0; i < rays.n; ++i)
  {
    const float oz = rays.z[i] + 0.5f * length;
    const float m1 = length * oz;
    const float m3 = rays.x[i] * dx + rays.y[i] * dy + oz * dz;
    const float k1 = cone * m3 - m1 * m2 + m2 * thinner;
    const float k0 =
        cone * (rays.x[i] * rays.x[i] + rays.y[i] * rays.y[i] + oz * oz) - m1 * m1 + 2.0f * m1 * thinner - l2;
    const float root = k1 * k1 - k0 * k2;
    const float along = m1 - thinner + (-k1 - std::sqrt(std::max(root, 0.0f))) / k2 * m2;
    light[i] = (root > 0.0f) & (along > 0.0f) & (along < cone) ? dark : light[i];
  }
}

PI_SIMULATION_VECTORISED void castWedge(const SunRays& rays, const Primitive& p, float dark, float* light)
{
  const float front = 0.5f * p.taper;
  const float rear = 0.5f * p.rear;
  const float sides = 0.5f * p.sides;
  const float planes[6][4] = {{1.0f, 0.0f, front, 1.0f - front}, {-1.0f, 0.0f, rear, 1.0f - rear},
                              {0.0f, 1.0f, sides, 1.0f - sides}, {0.0f, -1.0f, sides, 1.0f - sides},
                              {0.0f, 0.0f, 1.0f, 1.0f},          {0.0f, 0.0f, -1.0f, 1.0f}};
  float enter[LANES];
  float leave[LANES];
  std::fill(enter, enter + rays.n, -1e30f);
  std::fill(leave, leave + rays.n, 1e30f);
  for (const auto& plane : planes)
  {
    const float nx = plane[0];
    const float ny = plane[1];
    const float nz = plane[2];
    const float into = nx * rays.d.x() + ny * rays.d.y() + nz * rays.d.z();
    const float scale = 1.0f / into;
    for (int i = 0; i < rays.n; ++i)
    {
      const float t = (plane[3] - nx * rays.x[i] - ny * rays.y[i] - nz * rays.z[i]) * scale;
      enter[i] = into < 0.0f ? std::max(enter[i], t) : enter[i];
      leave[i] = into < 0.0f ? leave[i] : std::min(leave[i], t);
    }
  }
  for (int i = 0; i < rays.n; ++i)
  {
    light[i] = (enter[i] < leave[i]) & (leave[i] > 0.0f) ? dark : light[i];
  }
}

/// Of a thin one: where its middle plane is not the hole.
PI_SIMULATION_VECTORISED void castRing(const SunRays& rays, float hole, float dark, float* light)
{
  const float scale = 1.0f / rays.d.z();
  for (int i = 0; i < rays.n; ++i)
  {
    const float x = rays.x[i] - rays.z[i] * scale * rays.d.x();
    const float y = rays.y[i] - rays.z[i] * scale * rays.d.y();
    const float r2 = x * x + y * y;
    light[i] = (r2 < 1.0f) & (r2 > hole * hole) ? dark : light[i];
  }
}

void castPrimitive(const Primitive& p, const SunRays& rays, float dark, float* light)
{
  switch (p.shape)
  {
    case Shape::BOX:
    case Shape::WEDGE:
      return castWedge(rays, p, dark, light);
    case Shape::CYLINDER:
      return castCylinder(rays, dark, light);
    case Shape::SPHERE:
      return castBall(rays, 0.0f, 1.0f, dark, light);
    case Shape::CAPSULE:
      castBall(rays, -0.5f * p.length, 1.0f, dark, light);
      castBall(rays, 0.5f * p.length, p.taper, dark, light);
      return castSide(rays, p.length, p.taper, dark, light);
    case Shape::RING:
      return castRing(rays, p.taper, dark, light);
    case Shape::ROOM:
    case Shape::GROUND:
      return;
  }
}

}  // namespace

Shadows::Shadows(const std::vector<Primitive>& primitives, size_t first, const Eigen::Vector3f& sun, float ground_z)
  : sun_(sun), ground_z_(ground_z)
{
  std::vector<Bounds> shadows;
  const Eigen::Vector3f way = -sun / sun.z();
  for (size_t i = first; i < primitives.size(); ++i)
  {
    const Bounds bounds = primitives[i].bounds();
    Bounds shadow;
    for (const float z : {bounds.low.z(), bounds.high.z()})
    {
      const Eigen::Vector3f shift = std::max(z - ground_z, 0.0f) * way;
      shadow.add({bounds.low + shift, bounds.high + shift});
    }
    shadow.low.z() = shadow.high.z() = ground_z;
    shadows.push_back(shadow);
  }
  tree_ = BoundingTree(shadows);
}

void Shadows::cast(const Primitive* first, const float* u, const float* v, int n, float dark, float* light) const
{
  const std::vector<BoundingTree::Node>& nodes = tree_.nodes();
  if (nodes.empty())
  {
    return;
  }
  const auto [west, east] = std::minmax_element(u, u + n);
  const auto [south, north] = std::minmax_element(v, v + n);
  std::array<int32_t, 64> stack;  // the tree halves at each level
  size_t depth = 0;
  stack[depth++] = 0;
  SunRays rays;
  while (depth > 0)
  {
    const int32_t index = stack[--depth];
    const BoundingTree::Node& node = nodes[static_cast<size_t>(index)];
    if (node.bounds.low.x() > *east || node.bounds.high.x() < *west || node.bounds.low.y() > *north ||
        node.bounds.high.y() < *south)
    {
      continue;
    }
    if (node.right != 0)
    {
      stack[depth++] = node.right;
      stack[depth++] = index + 1;
      continue;
    }
    const Primitive& primitive = first[node.leaf];
    toUnit(primitive, u, v, ground_z_, n, sun_, &rays);
    castPrimitive(primitive, rays, dark, light);
  }
}

}  // namespace pi_simulation::synthetic
