#pragma once

// Where a ray meets a shape, for rays from one point (trace.cpp) and for rays to the sun (shadow.cpp). All is inlined
// into loops over rays: the compiler moves out what depends only on the common origin or direction. A ray counts as a
// line here: it may also meet what lies behind its origin.

#include "renderer/ray_packet.h"

#include <algorithm>
#include <cmath>

#define PI_SIMULATION_INLINE inline __attribute__((always_inline))

namespace pi_simulation::synthetic
{

/// A ray in the unit frame of a primitive, where distances along it are those in the world.
struct UnitRay
{
  float ox, oy, oz;  ///< origin
  float dx, dy, dz;  ///< direction, of any length
};

/// Part of a ray; empty if it ends before it begins.
struct Interval
{
  float enter;
  float leave;
};

/// Ball around a point of the z axis. @param t  where first; of any value for a miss.
PI_SIMULATION_INLINE bool meetsBall(const UnitRay& r, float z, float radius, float* t)
{
  const float oz = r.oz - z;
  const float a = r.dx * r.dx + r.dy * r.dy + r.dz * r.dz;
  const float b = r.ox * r.dx + r.oy * r.dy + oz * r.dz;
  const float root = b * b - a * (r.ox * r.ox + r.oy * r.oy + oz * oz - radius * radius);
  *t = (-b - std::sqrt(std::max(root, 0.0f))) / a;
  return root > 0.0f;
}

/// Hull of two balls (Quilez, "rounded cone"; here for directions of any length). @param t  where first.
PI_SIMULATION_INLINE bool meetsCapsule(const UnitRay& r, float length, float taper, float* t)
{
  float low_t, high_t;
  const bool low = meetsBall(r, -0.5f * length, 1.0f, &low_t);
  const bool high = meetsBall(r, 0.5f * length, taper, &high_t);
  const float thinner = 1.0f - taper;
  const float l2 = length * length;
  const float cone = l2 - thinner * thinner;  // square of the contact line's length
  const float oz = r.oz + 0.5f * length;      // above the lower ball
  const float m1 = length * oz;
  const float m2 = length * r.dz;
  const float m3 = r.ox * r.dx + r.oy * r.dy + oz * r.dz;
  const float k0 = cone * (r.ox * r.ox + r.oy * r.oy + oz * oz) - m1 * m1 + 2.0f * m1 * thinner - l2;
  const float k1 = cone * m3 - m1 * m2 + m2 * thinner;
  const float k2 = cone * (r.dx * r.dx + r.dy * r.dy + r.dz * r.dz) - m2 * m2;
  const float root = k1 * k1 - k0 * k2;
  const float side_t = (-k1 - std::sqrt(std::max(root, 0.0f))) / k2;
  const float along = m1 - thinner + side_t * m2;
  const bool side = (root > 0.0f) & (along > 0.0f) & (along < cone);
  *t = std::min(std::min(low ? low_t : RayPacket::FAR_M, high ? high_t : RayPacket::FAR_M),
                side ? side_t : RayPacket::FAR_M);
  return low | high | side;
}

/// Side of an endless cylinder. @param in  of any value for a miss.
PI_SIMULATION_INLINE bool meetsSide(const UnitRay& r, Interval* in)
{
  const float a = std::max(r.dx * r.dx + r.dy * r.dy, 1e-12f);
  const float b = r.ox * r.dx + r.oy * r.dy;
  const float root = b * b - a * (r.ox * r.ox + r.oy * r.oy - 1.0f);
  const float reach = std::sqrt(std::max(root, 0.0f));
  *in = {(-b - reach) / a, (-b + reach) / a};
  return root > 0.0f;
}

/// Between the planes of a cylinder's faces. @param divide  a / b, or faster where all rays have the same b.
template <typename Divide>
PI_SIMULATION_INLINE Interval meetFaces(const UnitRay& r, Divide divide)
{
  const float first = r.dz > 0.0f ? -1.0f : 1.0f;
  return {divide(first - r.oz, r.dz), divide(-first - r.oz, r.dz)};
}

/// Squared distance of a ray's point from the z axis.
PI_SIMULATION_INLINE float squaredRadius(const UnitRay& r, float t)
{
  const float x = r.ox + t * r.dx;
  const float y = r.oy + t * r.dy;
  return x * x + y * y;
}

/// Cuts a ray at the plane nx x + ny y + nz z = offset: what is before it is outside.
template <typename Divide>
PI_SIMULATION_INLINE void cut(const UnitRay& r, float nx, float ny, float nz, float offset, Divide divide, Interval* in)
{
  const float into = nx * r.dx + ny * r.dy + nz * r.dz;
  const float t = divide(offset - nx * r.ox - ny * r.oy - nz * r.oz, into);
  const float enter = std::max(in->enter, t);
  const float leave = std::min(in->leave, t);
  in->enter = into < 0.0f ? enter : in->enter;
  in->leave = into < 0.0f ? in->leave : leave;
}

/// @param front, rear, sides  half of what Shape::WEDGE says.
template <typename Divide>
PI_SIMULATION_INLINE Interval meetWedge(const UnitRay& r, float front, float rear, float sides, Divide divide)
{
  Interval in{-RayPacket::FAR_M, RayPacket::FAR_M};
  cut(r, 1.0f, 0.0f, front, 1.0f - front, divide, &in);
  cut(r, -1.0f, 0.0f, rear, 1.0f - rear, divide, &in);
  cut(r, 0.0f, 1.0f, sides, 1.0f - sides, divide, &in);
  cut(r, 0.0f, -1.0f, sides, 1.0f - sides, divide, &in);
  cut(r, 0.0f, 0.0f, 1.0f, 1.0f, divide, &in);
  cut(r, 0.0f, 0.0f, -1.0f, 1.0f, divide, &in);
  return in;
}

}  // namespace pi_simulation::synthetic
