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

/// @param hole  radius of what its faces leave open: of a thin ring, whose inner side is not there.
PI_SIMULATION_VECTORISED void hitCylinder(const UnitRays& rays, float hole, int32_t id, RayPacket* p)
{
  const float hole2 = hole * hole;
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
    const float cap_r2 = cap_x * cap_x + cap_y * cap_y;
    const bool on_cap = (cap_r2 <= 1.0f) & (cap_r2 >= hole2) & (cap > NEAR_M);
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

/// Hull of two balls (Quilez, "rounded cone"; here for directions of any length).
PI_SIMULATION_VECTORISED void hitCapsule(const UnitRays& rays, float length, float taper, int32_t id, RayPacket* p)
{
  const float ox = rays.origin.x();
  const float oy = rays.origin.y();
  const float low_z = rays.origin.z() + 0.5f * length;  // of the origin above the lower ball
  const float high_z = rays.origin.z() - 0.5f * length;
  const float across = ox * ox + oy * oy;
  const float low_c = across + low_z * low_z - 1.0f;
  const float high_c = across + high_z * high_z - taper * taper;
  const float thinner = 1.0f - taper;
  const float l2 = length * length;
  const float cone = l2 - thinner * thinner;  // square of the contact line's length
  const float m1 = length * low_z;
  const float k0 = cone * (across + low_z * low_z) - m1 * m1 + 2.0f * m1 * thinner - l2;
  const float far = RayPacket::FAR_M;
  for (int i = 0; i < LANES; ++i)
  {
    const Direction d = rays.direction(*p, i);
    const float a = d.x * d.x + d.y * d.y + d.z * d.z;
    const float flat = ox * d.x + oy * d.y;
    const float low_b = flat + low_z * d.z;
    const float high_b = flat + high_z * d.z;
    const float low_root = low_b * low_b - a * low_c;
    const float high_root = high_b * high_b - a * high_c;
    const float low_t = (-low_b - std::sqrt(std::max(low_root, 0.0f))) / a;
    const float high_t = (-high_b - std::sqrt(std::max(high_root, 0.0f))) / a;
    const float m2 = length * d.z;
    const float k1 = cone * low_b - m1 * m2 + m2 * thinner;
    const float k2 = cone * a - m2 * m2;
    const float root = k1 * k1 - k0 * k2;
    const float side_t = (-k1 - std::sqrt(std::max(root, 0.0f))) / k2;
    const float along = m1 - thinner + side_t * m2;
    const bool on_side = (root > 0.0f) & (along > 0.0f) & (along < cone);
    const float ball = std::min(low_root > 0.0f ? low_t : far, high_root > 0.0f ? high_t : far);
    const float t = std::min(ball, on_side ? side_t : far);
    const bool hit = (t > NEAR_M) & (t < p->t[i]);
    p->t[i] = hit ? t : p->t[i];
    p->hit[i] = hit ? id : p->hit[i];
  }
}

/// Cuts a ray at the plane nx x + ny y + nz z = offset: what is before it is outside.
inline void cut(const Direction& d, const Eigen::Vector3f& o, float nx, float ny, float nz, float offset, Interval* in)
{
  const float into = nx * d.x + ny * d.y + nz * d.z;
  const float t = (offset - nx * o.x() - ny * o.y() - nz * o.z()) / into;
  in->enter = into < 0.0f ? std::max(in->enter, t) : in->enter;
  in->leave = into < 0.0f ? in->leave : std::min(in->leave, t);
}

PI_SIMULATION_VECTORISED void hitWedge(const UnitRays& rays, float front, float rear, float sides, int32_t id,
                                       RayPacket* p)
{
  const Eigen::Vector3f o = rays.origin;
  for (int i = 0; i < LANES; ++i)
  {
    const Direction d = rays.direction(*p, i);
    Interval inside{-RayPacket::FAR_M, RayPacket::FAR_M};
    cut(d, o, 1.0f, 0.0f, 0.5f * front, 1.0f - 0.5f * front, &inside);
    cut(d, o, -1.0f, 0.0f, 0.5f * rear, 1.0f - 0.5f * rear, &inside);
    cut(d, o, 0.0f, 1.0f, 0.5f * sides, 1.0f - 0.5f * sides, &inside);
    cut(d, o, 0.0f, -1.0f, 0.5f * sides, 1.0f - 0.5f * sides, &inside);
    cut(d, o, 0.0f, 0.0f, 1.0f, 1.0f, &inside);
    cut(d, o, 0.0f, 0.0f, -1.0f, 1.0f, &inside);
    const bool hit = (inside.enter <= inside.leave) & (inside.enter > NEAR_M) & (inside.enter < p->t[i]);
    p->t[i] = hit ? inside.enter : p->t[i];
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
      return hitCylinder(rays, 0.0f, id, packet);
    case Shape::SPHERE:
      return hitSphere(rays, id, packet);
    case Shape::CAPSULE:
      return hitCapsule(rays, primitive.length, primitive.taper, id, packet);
    case Shape::WEDGE:
      return hitWedge(rays, primitive.taper, primitive.rear, primitive.sides, id, packet);
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
