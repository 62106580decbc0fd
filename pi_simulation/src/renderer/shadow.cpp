#include "renderer/shadow.h"

#include "renderer/scene.h"
#include "renderer/texture.h"
#include "renderer/unit_ray.h"

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

/// Darkens the points whose rays meet a shape. @param meets  whether a UnitRay does.
template <typename Meets>
PI_SIMULATION_INLINE void cast(const SunRays& rays, float dark, float* light, Meets meets)
{
  const float dx = rays.d.x();
  const float dy = rays.d.y();
  const float dz = rays.d.z();
  for (int i = 0; i < rays.n; ++i)
  {
    float t;
    const float old = light[i];
    light[i] = meets(UnitRay{rays.x[i], rays.y[i], rays.z[i], dx, dy, dz}, &t) ? dark : old;
  }
}

/// By the same b for all rays.
constexpr auto DIVIDE = [](float a, float b) { return a * (1.0f / b); };

PI_SIMULATION_VECTORISED void castBall(const SunRays& rays, float dark, float* light)
{
  cast(rays, dark, light, [](const UnitRay& ray, float* t) { return meetsBall(ray, 0.0f, 1.0f, t); });
}

PI_SIMULATION_VECTORISED void castCapsule(const SunRays& rays, const Primitive& p, float dark, float* light)
{
  cast(rays, dark, light,
       [length = p.length, taper = p.taper](const UnitRay& ray, float* t)
       { return meetsCapsule(ray, length, taper, t); });
}

PI_SIMULATION_VECTORISED void castCylinder(const SunRays& rays, float dark, float* light)
{
  cast(rays, dark, light,
       [](const UnitRay& ray, float*)
       {
         Interval side;
         const bool met = meetsSide(ray, &side);
         const Interval faces = meetFaces(ray, DIVIDE);
         return met & (std::max(side.enter, faces.enter) < std::min(side.leave, faces.leave));
       });
}

PI_SIMULATION_VECTORISED void castWedge(const SunRays& rays, const Primitive& p, float dark, float* light)
{
  cast(rays, dark, light,
       [front = 0.5f * p.taper, rear = 0.5f * p.rear, sides = 0.5f * p.sides](const UnitRay& ray, float*)
       {
         const Interval inside = meetWedge(ray, front, rear, sides, DIVIDE);
         return (inside.enter < inside.leave) & (inside.leave > 0.0f);
       });
}

/// Of a thin one: where its middle plane is not the hole.
PI_SIMULATION_VECTORISED void castRing(const SunRays& rays, float hole, float dark, float* light)
{
  cast(rays, dark, light,
       [hole](const UnitRay& ray, float*)
       {
         const float r2 = squaredRadius(ray, DIVIDE(-ray.oz, ray.dz));
         return (r2 < 1.0f) & (r2 > hole * hole);
       });
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
      return castBall(rays, dark, light);
    case Shape::CAPSULE:
      return castCapsule(rays, p, dark, light);
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
