#include "renderer/ray_packet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace pi_simulation::synthetic
{

namespace
{

constexpr float NEAR_M = 0.02f;

struct Direction
{
  float x;
  float y;
  float z;
};

/// The rays in the unit frame of a primitive, where distances along a ray stay the same.
struct UnitRays
{
  UnitRays(const Primitive& primitive, const RayPacket& packet)
    : origin(primitive.to_unit * (packet.origin - primitive.center))
  {
    for (int row = 0; row < 3; ++row)
    {
      for (int column = 0; column < 3; ++column)
      {
        m[row][column] = primitive.to_unit(row, column);
      }
    }
  }

  Direction direction(const RayPacket& packet, int i) const
  {
    return {m[0][0] * packet.dx[i] + m[0][1] * packet.dy[i] + m[0][2] * packet.dz[i],
            m[1][0] * packet.dx[i] + m[1][1] * packet.dy[i] + m[1][2] * packet.dz[i],
            m[2][0] * packet.dx[i] + m[2][1] * packet.dy[i] + m[2][2] * packet.dz[i]};
  }

  Eigen::Vector3f origin;
  float m[3][3];
};

struct Interval
{
  float enter;
  float leave;
};

/// Where a ray is inside of [-1, 1]^3 (slab method).
inline Interval cubeInterval(const Direction& d, float ox, float oy, float oz)
{
  const float ix = 1.0f / d.x;
  const float iy = 1.0f / d.y;
  const float iz = 1.0f / d.z;
  const float x1 = (-1.0f - ox) * ix;
  const float x2 = (1.0f - ox) * ix;
  const float y1 = (-1.0f - oy) * iy;
  const float y2 = (1.0f - oy) * iy;
  const float z1 = (-1.0f - oz) * iz;
  const float z2 = (1.0f - oz) * iz;
  return {std::max(std::max(std::min(x1, x2), std::min(y1, y2)), std::min(z1, z2)),
          std::min(std::min(std::max(x1, x2), std::max(y1, y2)), std::max(z1, z2))};
}

PI_SIMULATION_VECTORISED void hitBox(const UnitRays& rays, int32_t id, RayPacket* p)
{
  const float ox = rays.origin.x();
  const float oy = rays.origin.y();
  const float oz = rays.origin.z();
  for (int i = 0; i < LANES; ++i)
  {
    const Interval inside = cubeInterval(rays.direction(*p, i), ox, oy, oz);
    const bool hit = (inside.enter <= inside.leave) & (inside.enter > NEAR_M) & (inside.enter < p->t[i]);
    p->t[i] = hit ? inside.enter : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

PI_SIMULATION_VECTORISED void hitRoom(const UnitRays& rays, int32_t id, RayPacket* p)
{
  const float ox = rays.origin.x();
  const float oy = rays.origin.y();
  const float oz = rays.origin.z();
  for (int i = 0; i < LANES; ++i)
  {
    const Interval inside = cubeInterval(rays.direction(*p, i), ox, oy, oz);
    const bool hit = (inside.enter <= inside.leave) & (inside.leave > NEAR_M) & (inside.leave < p->t[i]);
    p->t[i] = hit ? inside.leave : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

PI_SIMULATION_VECTORISED void hitGround(const UnitRays& rays, int32_t id, RayPacket* p)
{
  const float oz = rays.origin.z();
  for (int i = 0; i < LANES; ++i)
  {
    const float t = -oz / rays.direction(*p, i).z;
    const bool hit = (t > NEAR_M) & (t < p->t[i]);
    p->t[i] = hit ? t : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

PI_SIMULATION_VECTORISED void hitCylinder(const UnitRays& rays, int32_t id, RayPacket* p)
{
  const float ox = rays.origin.x();
  const float oy = rays.origin.y();
  const float oz = rays.origin.z();
  for (int i = 0; i < LANES; ++i)
  {
    const Direction d = rays.direction(*p, i);
    const float a = d.x * d.x + d.y * d.y;
    const float b = ox * d.x + oy * d.y;
    const float root = b * b - a * (ox * ox + oy * oy - 1.0f);
    const float side = (-b - std::sqrt(std::max(root, 0.0f))) / std::max(a, 1e-12f);
    const float cap = ((d.z > 0.0f ? -1.0f : 1.0f) - oz) / d.z;
    const float cap_x = ox + cap * d.x;
    const float cap_y = oy + cap * d.y;
    const bool on_side = (root > 0.0f) & (std::abs(oz + side * d.z) <= 1.0f) & (side > NEAR_M);
    const bool on_cap = (cap_x * cap_x + cap_y * cap_y <= 1.0f) & (cap > NEAR_M);
    const float t = std::min(on_side ? side : RayPacket::FAR_M, on_cap ? cap : RayPacket::FAR_M);
    const bool hit = t < p->t[i];
    p->t[i] = hit ? t : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

PI_SIMULATION_VECTORISED void hitSphere(const UnitRays& rays, int32_t id, RayPacket* p)
{
  const float ox = rays.origin.x();
  const float oy = rays.origin.y();
  const float oz = rays.origin.z();
  const float c = ox * ox + oy * oy + oz * oz - 1.0f;
  for (int i = 0; i < LANES; ++i)
  {
    const Direction d = rays.direction(*p, i);
    const float a = d.x * d.x + d.y * d.y + d.z * d.z;
    const float b = ox * d.x + oy * d.y + oz * d.z;
    const float root = b * b - a * c;
    const float t = (-b - std::sqrt(std::max(root, 0.0f))) / a;
    const bool hit = (root > 0.0f) & (t > NEAR_M) & (t < p->t[i]);
    p->t[i] = hit ? t : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

void hitPrimitive(const Primitive& primitive, int32_t id, RayPacket* packet)
{
  const UnitRays rays(primitive, *packet);
  switch (primitive.shape)
  {
    case Shape::BOX:
      return hitBox(rays, id, packet);
    case Shape::CYLINDER:
      return hitCylinder(rays, id, packet);
    case Shape::SPHERE:
      return hitSphere(rays, id, packet);
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

}  // namespace pi_simulation::synthetic
