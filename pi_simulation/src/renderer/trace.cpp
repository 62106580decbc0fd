#include "renderer/unit_ray.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace pi_simulation::synthetic
{

namespace
{

constexpr float NEAR_M = 0.02f;

/// The rays of a packet in the unit frame of a primitive.
struct UnitRays
{
  UnitRays(const Primitive& primitive, const RayPacket& packet)
  {
    Eigen::Vector3f::Map(o) = primitive.to_unit * (packet.origin - primitive.center);
    Eigen::Matrix3f::Map(m[0]) = primitive.to_unit;
  }

  UnitRay ray(const RayPacket& p, int i) const
  {
    return {o[0],
            o[1],
            o[2],
            m[0][0] * p.dx[i] + m[1][0] * p.dy[i] + m[2][0] * p.dz[i],
            m[0][1] * p.dx[i] + m[1][1] * p.dy[i] + m[2][1] * p.dz[i],
            m[0][2] * p.dx[i] + m[1][2] * p.dy[i] + m[2][2] * p.dz[i]};
  }

  float o[3];
  float m[3][3];  ///< columns
};

/// Shortens the rays that meet a shape. @param meets  whether a UnitRay does, and where.
template <typename Meets>
PI_SIMULATION_INLINE void hit(const UnitRays& rays, int32_t id, RayPacket* p, Meets meets)
{
  for (int i = 0; i < LANES; ++i)
  {
    float t;
    const bool hit = meets(rays.ray(*p, i), &t) & (t < p->t[i]);
    p->t[i] = hit ? t : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

constexpr auto DIVIDE = [](float a, float b) { return a / b; };

/// Where a ray is inside of [-1, 1]^3 (slab method).
PI_SIMULATION_INLINE Interval cubeInterval(const UnitRay& r)
{
  const float ix = 1.0f / r.dx;
  const float iy = 1.0f / r.dy;
  const float iz = 1.0f / r.dz;
  const float x1 = (-1.0f - r.ox) * ix;
  const float x2 = (1.0f - r.ox) * ix;
  const float y1 = (-1.0f - r.oy) * iy;
  const float y2 = (1.0f - r.oy) * iy;
  const float z1 = (-1.0f - r.oz) * iz;
  const float z2 = (1.0f - r.oz) * iz;
  return {std::max(std::max(std::min(x1, x2), std::min(y1, y2)), std::min(z1, z2)),
          std::min(std::min(std::max(x1, x2), std::max(y1, y2)), std::max(z1, z2))};
}

PI_SIMULATION_VECTORISED void hitBox(const UnitRays& rays, int32_t id, RayPacket* p)
{
  hit(rays, id, p,
      [](const UnitRay& ray, float* t)
      {
        const Interval inside = cubeInterval(ray);
        *t = inside.enter;
        return (inside.enter <= inside.leave) & (*t > NEAR_M);
      });
}

PI_SIMULATION_VECTORISED void hitRoom(const UnitRays& rays, int32_t id, RayPacket* p)
{
  hit(rays, id, p,
      [](const UnitRay& ray, float* t)
      {
        const Interval inside = cubeInterval(ray);
        *t = inside.leave;
        return (inside.enter <= inside.leave) & (*t > NEAR_M);
      });
}

PI_SIMULATION_VECTORISED void hitGround(const UnitRays& rays, int32_t id, RayPacket* p)
{
  hit(rays, id, p,
      [](const UnitRay& ray, float* t)
      {
        *t = -ray.oz / ray.dz;
        return *t > NEAR_M;
      });
}

/// @param hole  radius of what its faces leave open: of a thin ring, whose inner side is not there.
PI_SIMULATION_VECTORISED void hitCylinder(const UnitRays& rays, float hole, int32_t id, RayPacket* p)
{
  hit(rays, id, p,
      [hole](const UnitRay& ray, float* t)
      {
        Interval side;
        const bool met = meetsSide(ray, &side);
        const float face = meetFaces(ray, DIVIDE).enter;
        const float face_r2 = squaredRadius(ray, face);
        const bool on_side = met & (std::abs(ray.oz + side.enter * ray.dz) <= 1.0f) & (side.enter > NEAR_M);
        const bool on_face = (face_r2 <= 1.0f) & (face_r2 >= hole * hole) & (face > NEAR_M);
        *t = std::min(on_side ? side.enter : RayPacket::FAR_M, on_face ? face : RayPacket::FAR_M);
        return true;
      });
}

PI_SIMULATION_VECTORISED void hitSphere(const UnitRays& rays, int32_t id, RayPacket* p)
{
  hit(rays, id, p, [](const UnitRay& ray, float* t) { return meetsBall(ray, 0.0f, 1.0f, t) & (*t > NEAR_M); });
}

PI_SIMULATION_VECTORISED void hitCapsule(const UnitRays& rays, float length, float taper, int32_t id, RayPacket* p)
{
  hit(rays, id, p,
      [length, taper](const UnitRay& ray, float* t) { return meetsCapsule(ray, length, taper, t) & (*t > NEAR_M); });
}

PI_SIMULATION_VECTORISED void hitWedge(const UnitRays& rays, const Primitive& wedge, int32_t id, RayPacket* p)
{
  hit(rays, id, p,
      [front = 0.5f * wedge.taper, rear = 0.5f * wedge.rear, sides = 0.5f * wedge.sides](const UnitRay& ray, float* t)
      {
        const Interval inside = meetWedge(ray, front, rear, sides, DIVIDE);
        *t = inside.enter;
        return (inside.enter <= inside.leave) & (*t > NEAR_M);
      });
}

void hitPrimitive(const Primitive& primitive, int32_t id, RayPacket* packet)
{
  const UnitRays rays(primitive, *packet);
  switch (primitive.shape)
  {
    case Shape::BOX:
      return hitBox(rays, id, packet);
    case Shape::CYLINDER:
      return hitCylinder(rays, 0.0f, id, packet);
    case Shape::SPHERE:
      return hitSphere(rays, id, packet);
    case Shape::CAPSULE:
      return hitCapsule(rays, primitive.length, primitive.taper, id, packet);
    case Shape::WEDGE:
      return hitWedge(rays, primitive, id, packet);
    case Shape::RING:
      return hitCylinder(rays, primitive.taper, id, packet);
    case Shape::ROOM:
      return hitRoom(rays, id, packet);
    case Shape::GROUND:
      return hitGround(rays, id, packet);
  }
}

PI_SIMULATION_VECTORISED float farthest(const RayPacket& packet)
{
  // Eight maxima side by side: a single one would be a chain of comparisons that no vector code may reorder.
  float t[8] = {};
  for (int i = 0; i < LANES; i += 8)
  {
    for (int k = 0; k < 8; ++k)
    {
      t[k] = t[k] > packet.t[i + k] ? t[k] : packet.t[i + k];
    }
  }
  return *std::max_element(t, t + 8);
}

/// @param first  primitive of leaf 0; @param base  its index among all.
void collect(const BoundingTree& tree, const Primitive* first, int32_t base, const Frustum& frustum,
             std::vector<Candidates::Entry>* entries)
{
  const std::vector<BoundingTree::Node>& nodes = tree.nodes();
  if (nodes.empty())
  {
    return;
  }
  std::array<int32_t, 64> stack;  // the tree halves at each level
  size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0)
  {
    const int32_t index = stack[--depth];
    const BoundingTree::Node& node = nodes[static_cast<size_t>(index)];
    if (frustum.misses(node.bounds))
    {
      continue;
    }
    if (node.right == 0)
    {
      entries->push_back({frustum.squaredDistance(node.bounds), base + node.leaf, first + node.leaf, &node.bounds});
      continue;
    }
    stack[depth++] = node.right;
    stack[depth++] = index + 1;
  }
}

}  // namespace

void Candidates::find(const Scene& scene, const MovingScene& moving, const Frustum& frustum)
{
  entries.clear();
  collect(scene.tree, scene.primitives.data() + scene.unbounded, static_cast<int32_t>(scene.unbounded), frustum,
          &entries);
  collect(moving.tree, moving.primitives.data(), static_cast<int32_t>(scene.primitives.size()), frustum, &entries);
  // Ties are broken by index, for the same picture on every machine.
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) {
              return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance : a.id < b.id;
            });
}

void trace(const Scene& scene, const Candidates& candidates, const Frustum& frustum, RayPacket* packet)
{
  for (int i = 0; i < LANES; ++i)
  {
    packet->t[i] = RayPacket::FAR_M;
    packet->hit[i] = RayPacket::SKY;
  }
  for (size_t i = 0; i < scene.unbounded; ++i)
  {
    hitPrimitive(scene.primitives[i], static_cast<int32_t>(i), packet);
  }
  float reach = farthest(*packet);
  for (const Candidates::Entry& entry : candidates.entries)
  {
    if (entry.squared_distance > reach * reach)
    {
      return;  // and so are all behind it: all rays end before
    }
    if (!frustum.misses(*entry.bounds))
    {
      hitPrimitive(*entry.primitive, entry.id, packet);
      reach = farthest(*packet);
    }
  }
}

uint64_t silhouette(const Candidates& candidates, const Frustum& frustum, int32_t object, RayPacket* packet)
{
  std::fill(packet->t, packet->t + LANES, RayPacket::FAR_M);
  std::fill(packet->hit, packet->hit + LANES, RayPacket::SKY);
  for (const Candidates::Entry& entry : candidates.entries)
  {
    if (entry.primitive->object == object && !frustum.misses(*entry.bounds))
    {
      hitPrimitive(*entry.primitive, entry.id, packet);
    }
  }
  uint64_t lanes = 0;
  for (int i = 0; i < LANES; ++i)
  {
    lanes |= static_cast<uint64_t>(packet->hit[i] != RayPacket::SKY) << i;
  }
  return lanes;
}

}  // namespace pi_simulation::synthetic
