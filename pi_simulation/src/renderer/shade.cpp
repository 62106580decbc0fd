#include "renderer/ray_packet.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

/// Rays that hit the same primitive, side by side.
struct alignas(64) RayGroup
{
  int n = 0;  ///< rounded up to a multiple of 8
  int lanes = 0;
  int lane[LANES];
  float dx[LANES];
  float dy[LANES];
  float dz[LANES];
  float t[LANES];
  float spread[LANES];
};

/// The lanes of a packet by what they hit, in the order of their first lane.
class LanesByHit
{
public:
  explicit LanesByHit(const RayPacket& packet)
  {
    int last = -1;  // neighbours mostly hit the same
    for (int i = 0; i < LANES; ++i)
    {
      const int32_t id = packet.hit[i];
      if (last < 0 || ids_[last] != id)
      {
        last = static_cast<int>(std::find(ids_, ids_ + count_, id) - ids_);
        if (last == count_)
        {
          ids_[count_] = id;
          first_[count_++] = i;
        }
        else
        {
          next_[end_[last]] = i;
        }
      }
      else
      {
        next_[end_[last]] = i;
      }
      end_[last] = i;
      next_[i] = -1;
    }
  }

  int count() const { return count_; }
  int32_t id(int group) const { return ids_[group]; }

  RayGroup gather(const RayPacket& packet, int group) const
  {
    RayGroup g;
    for (int i = first_[group]; i >= 0; i = next_[i])
    {
      g.lane[g.lanes++] = i;
    }
    g.n = (g.lanes + 7) / 8 * 8;
    for (int k = 0; k < g.n; ++k)
    {
      const int i = g.lane[k < g.lanes ? k : 0];
      g.dx[k] = packet.dx[i];
      g.dy[k] = packet.dy[i];
      g.dz[k] = packet.dz[i];
      g.t[k] = packet.t[i];
      g.spread[k] = packet.spread[i];
    }
    return g;
  }

private:
  int count_ = 0;
  int32_t ids_[LANES];
  int first_[LANES];
  int end_[LANES];
  int next_[LANES];
};

/// All lanes of a packet.
void gatherAll(const RayPacket& packet, RayGroup* g)
{
  g->n = g->lanes = LANES;
  std::copy_n(packet.dx, LANES, g->dx);
  std::copy_n(packet.dy, LANES, g->dy);
  std::copy_n(packet.dz, LANES, g->dz);
  std::copy_n(packet.t, LANES, g->t);
  std::copy_n(packet.spread, LANES, g->spread);
}

PI_SIMULATION_VECTORISED bool allHit(const RayPacket& packet, int32_t id)
{
  int others = 0;
  for (int i = 0; i < LANES; ++i)
  {
    others |= packet.hit[i] ^ id;
  }
  return others == 0;
}

PI_SIMULATION_VECTORISED void colourAll(const Surface& surface, RayPacket* packet)
{
  for (int i = 0; i < LANES; ++i)
  {
    packet->r[i] = surface.r[i] * surface.light[i];
    packet->g[i] = surface.g[i] * surface.light[i];
    packet->b[i] = surface.b[i] * surface.light[i];
    packet->face[i] = surface.face[i];
  }
}

/// arctan2 within 1e-5 rad in vector code (polynomial of Hastings, Approximations for Digital Computers, 1955).
inline float fastAtan2(float y, float x)
{
  const float ax = std::abs(x);
  const float ay = std::abs(y);
  const float q = std::min(ax, ay) / std::max(std::max(ax, ay), 1e-20f);
  const float s = q * q;
  const float a =
      q *
      (0.99997726f + s * (-0.33262347f + s * (0.19354346f + s * (-0.11643287f + s * (0.05265332f - s * 0.01172120f)))));
  const float steep = ay > ax ? 1.57079633f - a : a;
  const float half_turn = x < 0.0f ? 3.14159265f - steep : steep;
  return y < 0.0f ? -half_turn : half_turn;
}

/// Hit points and directions in the local axes of a primitive.
struct alignas(64) LocalHits
{
  float x[LANES];  ///< points in the unit shape
  float y[LANES];
  float z[LANES];
  float dx[LANES];  ///< unit directions along the local axes
  float dy[LANES];
  float dz[LANES];
};

PI_SIMULATION_VECTORISED void localise(const Primitive& primitive, const Eigen::Vector3f& origin, const RayGroup& g,
                                       LocalHits* hits)
{
  const Eigen::Vector3f o = primitive.to_unit * (origin - primitive.center);
  const Eigen::Matrix3f m = primitive.rotation.transpose();
  const float ox = o.x();
  const float oy = o.y();
  const float oz = o.z();
  const float ix = 1.0f / primitive.half.x();
  const float iy = 1.0f / primitive.half.y();
  const float iz = 1.0f / primitive.half.z();
  const float m00 = m(0, 0), m01 = m(0, 1), m02 = m(0, 2);
  const float m10 = m(1, 0), m11 = m(1, 1), m12 = m(1, 2);
  const float m20 = m(2, 0), m21 = m(2, 1), m22 = m(2, 2);
  for (int i = 0; i < g.n; ++i)
  {
    const float dx = m00 * g.dx[i] + m01 * g.dy[i] + m02 * g.dz[i];
    const float dy = m10 * g.dx[i] + m11 * g.dy[i] + m12 * g.dz[i];
    const float dz = m20 * g.dx[i] + m21 * g.dy[i] + m22 * g.dz[i];
    hits->dx[i] = dx;
    hits->dy[i] = dy;
    hits->dz[i] = dz;
    hits->x[i] = ox + g.t[i] * dx * ix;
    hits->y[i] = oy + g.t[i] * dy * iy;
    hits->z[i] = oz + g.t[i] * dz * iz;
  }
}

/// Width of a pixel along a surface axis a: t * spread * |a - n (a d) / (n d)|, the projection of the pixel's cone.
inline float footprint(float t, float spread, float along, float into)
{
  const float slope = along / std::max(std::abs(into), 0.01f);
  return std::max(t * spread * std::sqrt(1.0f + slope * slope), 1e-5f);
}

/// What face of a box or wedge a hit is on.
struct BoxFace
{
  float x, y, z;  ///< weights, one of which is 1: choices by conditions would not become vector code
  float out;      ///< 1 or -1: towards which end of the axis
};

// The compiler gives up on telling a dozen arrays apart: __restrict says that the result overlaps none of the inputs.

/// Sets u, v and face of hit i. @param ax, ay, az  the largest is the axis of the face. @param turn  -1: inside out.
inline BoxFace chooseFace(float ax, float ay, float az, float turn, const Eigen::Vector3f& half, const LocalHits& h,
                          int i, Surface* __restrict s)
{
  const float most = std::max(ax, std::max(ay, az));
  const float on_x = ax == most ? 1.0f : 0.0f;
  const float on_y = (1.0f - on_x) * (ay == most ? 1.0f : 0.0f);
  const float on_z = 1.0f - on_x - on_y;
  const float out = on_x * h.x[i] + on_y * h.y[i] + on_z * h.z[i] > 0.0f ? 1.0f : -1.0f;
  s->u[i] = on_x * turn * out * h.y[i] * half.y() - on_y * turn * out * h.x[i] * half.x() + on_z * h.x[i] * half.x();
  s->v[i] = (on_x + on_y) * h.z[i] * half.z() + on_z * h.y[i] * half.y();
  s->face[i] = static_cast<int32_t>(2.0f * on_y + 4.0f * on_z + 0.5f + 0.5f * out);
  return {on_x, on_y, on_z, out};
}

/// Faces of a box; `inside` turns it inside out.
PI_SIMULATION_VECTORISED void boxSurface(const Primitive& primitive, float ambient, bool inside, const RayGroup& g,
                                         const LocalHits& h, Surface* __restrict s)
{
  const Eigen::Vector3f half = primitive.half;
  const float turn = inside ? -1.0f : 1.0f;
  const float sx = turn * primitive.sun_local.x();
  const float sy = turn * primitive.sun_local.y();
  const float sz = turn * primitive.sun_local.z();
  for (int i = 0; i < g.n; ++i)
  {
    const BoxFace on = chooseFace(std::abs(h.x[i]), std::abs(h.y[i]), std::abs(h.z[i]), turn, half, h, i, s);
    const float into = on.x * h.dx[i] + on.y * h.dy[i] + on.z * h.dz[i];
    s->wu[i] = footprint(g.t[i], g.spread[i], on.x * h.dy[i] + (on.y + on.z) * h.dx[i], into);
    s->wv[i] = footprint(g.t[i], g.spread[i], (on.x + on.y) * h.dz[i] + on.z * h.dy[i], into);
    const float sun = on.out * (on.x * sx + on.y * sy + on.z * sz);
    s->light[i] = ambient + (1.0f - ambient) * std::max(sun, 0.0f);
  }
}

PI_SIMULATION_VECTORISED void cylinderSurface(const Primitive& primitive, float ambient, const RayGroup& g,
                                              const LocalHits& h, Surface* __restrict s)
{
  const float hx = primitive.half.x();
  const float hy = primitive.half.y();
  const float hz = primitive.half.z();
  const float sx = primitive.sun_local.x();
  const float sy = primitive.sun_local.y();
  const float sz = primitive.sun_local.z();
  for (int i = 0; i < g.n; ++i)
  {
    // The surface that the point is nearest to, in metres: rounding puts points on thin, far cylinders off their side.
    const float radius = std::sqrt(h.x[i] * h.x[i] + h.y[i] * h.y[i]);
    const bool cap = std::abs(std::abs(h.z[i]) - 1.0f) * hz < std::abs(radius - 1.0f) * hx;
    const float out_z = h.z[i] > 0.0f ? 1.0f : -1.0f;
    s->u[i] = cap ? h.x[i] * hx : hx * fastAtan2(h.y[i], h.x[i]);
    s->v[i] = cap ? h.y[i] * hy : h.z[i] * hz;
    const float into = cap ? h.dz[i] : h.dx[i] * h.x[i] + h.dy[i] * h.y[i];
    s->wu[i] = footprint(g.t[i], g.spread[i], cap ? h.dx[i] : h.dy[i] * h.x[i] - h.dx[i] * h.y[i], into);
    s->wv[i] = footprint(g.t[i], g.spread[i], cap ? h.dy[i] : h.dz[i], into);
    const float sun = cap ? out_z * sz : h.x[i] * sx + h.y[i] * sy;
    s->light[i] = ambient + (1.0f - ambient) * std::max(sun, 0.0f);
    s->face[i] = cap ? (out_z > 0.0f ? 5 : 4) : 0;
  }
}

PI_SIMULATION_VECTORISED void sphereSurface(const Primitive& primitive, float ambient, const RayGroup& g,
                                            const LocalHits& h, Surface* __restrict s)
{
  const float hx = primitive.half.x();
  const float hz = primitive.half.z();
  const float sx = primitive.sun_local.x();
  const float sy = primitive.sun_local.y();
  const float sz = primitive.sun_local.z();
  for (int i = 0; i < g.n; ++i)
  {
    s->u[i] = hx * fastAtan2(h.y[i], h.x[i]);
    s->v[i] = h.z[i] * hz;
    // The true normal of a flat ellipsoid leans a little; the eye does not see it.
    const float into = std::abs(h.dx[i] * h.x[i] + h.dy[i] * h.y[i] + h.dz[i] * h.z[i]);
    s->wu[i] = s->wv[i] = std::max(g.t[i] * g.spread[i] / std::max(into, 0.2f), 1e-5f);
    const float sun = h.x[i] * sx + h.y[i] * sy + h.z[i] * sz;
    s->light[i] = ambient + (1.0f - ambient) * std::max(sun, 0.0f);
    s->face[i] = 0;
  }
}

PI_SIMULATION_VECTORISED void capsuleSurface(const Primitive& primitive, float ambient, const RayGroup& g,
                                             const LocalHits& h, Surface* __restrict s)
{
  const float ix = 1.0f / primitive.half.x();
  const float iy = 1.0f / primitive.half.y();
  const float iz = 1.0f / primitive.half.z();
  const float hx = primitive.half.x();
  const float hz = primitive.half.z();
  const float sx = primitive.sun_local.x();
  const float sy = primitive.sun_local.y();
  const float sz = primitive.sun_local.z();
  const float length = primitive.length;
  const float thinner = 1.0f - primitive.taper;
  const float scale = 1.0f / (length * length - thinner * thinner);
  for (int i = 0; i < g.n; ++i)
  {
    // The normal points away from the nearest ball between the two.
    const float low_z = h.z[i] + 0.5f * length;
    const float along = clamp01((length * low_z - thinner) * scale);
    const float nx = h.x[i] * ix;
    const float ny = h.y[i] * iy;
    const float nz = (low_z - along * length) * iz;
    const float norm = 1.0f / std::max(std::sqrt(nx * nx + ny * ny + nz * nz), 1e-12f);
    s->u[i] = hx * fastAtan2(h.y[i], h.x[i]);
    s->v[i] = h.z[i] * hz;
    const float into = std::abs(h.dx[i] * nx + h.dy[i] * ny + h.dz[i] * nz) * norm;
    s->wu[i] = s->wv[i] = std::max(g.t[i] * g.spread[i] / std::max(into, 0.2f), 1e-5f);
    const float sun = (nx * sx + ny * sy + nz * sz) * norm;
    s->light[i] = ambient * (1.0f + 0.25f * nz * norm) + (1.0f - ambient) * std::max(sun, 0.0f);
    s->face[i] = 0;
  }
}

PI_SIMULATION_VECTORISED void wedgeSurface(const Primitive& primitive, float ambient, const RayGroup& g,
                                           const LocalHits& h, Surface* __restrict s)
{
  const Eigen::Vector3f half = primitive.half;
  const float sx = primitive.sun_local.x();
  const float sy = primitive.sun_local.y();
  const float sz = primitive.sun_local.z();
  const float front = 0.5f * primitive.taper;
  const float rear = 0.5f * primitive.rear;
  const float sides = 0.5f * primitive.sides;
  for (int i = 0; i < g.n; ++i)
  {
    const float x = h.x[i];
    const float z = h.z[i];
    const float lean_x = x > 0.0f ? front : rear;
    const float ax = std::abs(x) + lean_x * z + lean_x;
    const float ay = std::abs(h.y[i]) + sides * z + sides;
    const BoxFace on = chooseFace(ax, ay, std::abs(z), 1.0f, half, h, i, s);
    const float nx = on.x * on.out / half.x();
    const float ny = on.y * on.out / half.y();
    const float nz = (on.z * on.out + on.x * lean_x + on.y * sides) / half.z();
    const float norm = 1.0f / std::sqrt(nx * nx + ny * ny + nz * nz);
    const float into = (nx * h.dx[i] + ny * h.dy[i] + nz * h.dz[i]) * norm;
    s->wu[i] = footprint(g.t[i], g.spread[i], on.x * h.dy[i] + (on.y + on.z) * h.dx[i], into);
    s->wv[i] = footprint(g.t[i], g.spread[i], (on.x + on.y) * h.dz[i] + on.z * h.dy[i], into);
    const float sun = (nx * sx + ny * sy + nz * sz) * norm;
    s->light[i] = ambient + (1.0f - ambient) * std::max(sun, 0.0f);
  }
}

PI_SIMULATION_VECTORISED void groundSurface(float light, const Eigen::Vector3f& origin, const RayGroup& g, Surface* s)
{
  const float ox = origin.x();
  const float oy = origin.y();
  for (int i = 0; i < g.n; ++i)
  {
    s->u[i] = ox + g.t[i] * g.dx[i];
    s->v[i] = oy + g.t[i] * g.dy[i];
    s->wu[i] = footprint(g.t[i], g.spread[i], g.dx[i], g.dz[i]);
    s->wv[i] = footprint(g.t[i], g.spread[i], g.dy[i], g.dz[i]);
    s->light[i] = light;
    s->face[i] = 5;
  }
}

void makeSurface(const Scene& scene, const MovingScene& moving, const Primitive& primitive,
                 const Eigen::Vector3f& origin, const RayGroup& group, Surface* surface)
{
  surface->n = group.n;
  if (primitive.shape == Shape::GROUND)
  {
    groundSurface(scene.ambient + (1.0f - scene.ambient) * scene.sun.z(), origin, group, surface);
    Surface& s = *surface;
    scene.shadows.cast(scene.primitives.data() + scene.unbounded, s.u, s.v, s.n, scene.ambient, s.light);
    moving.shadows.cast(moving.primitives.data(), s.u, s.v, s.n, scene.ambient, s.light);
    return;
  }
  LocalHits hits;
  localise(primitive, origin, group, &hits);
  switch (primitive.shape)
  {
    case Shape::CYLINDER:
    case Shape::RING:
      return cylinderSurface(primitive, scene.ambient, group, hits, surface);
    case Shape::SPHERE:
      return sphereSurface(primitive, scene.ambient, group, hits, surface);
    case Shape::CAPSULE:
      return capsuleSurface(primitive, scene.ambient, group, hits, surface);
    case Shape::WEDGE:
      return wedgeSurface(primitive, scene.ambient, group, hits, surface);
    default:
      return boxSurface(primitive, scene.ambient, primitive.shape == Shape::ROOM, group, hits, surface);
  }
}

/// Clouds on a plane far above, at infinity: the same seen from everywhere.
void shadeSky(uint32_t seed, const RayGroup& g, Surface* s)
{
  s->n = g.n;
  for (int i = 0; i < g.n; ++i)
  {
    const float up = std::max(g.dz[i], 0.0f) + 0.12f;
    s->u[i] = g.dx[i] / up;
    s->v[i] = g.dy[i] / up;
    s->wu[i] = s->wv[i] = g.spread[i] / (up * up);
    s->light[i] = 1.0f;
    s->face[i] = 0;
  }
  float noise[LANES];
  fractalNoise(*s, {1.1f, 6, 0.6f, 1.0f, seed}, noise);
  for (int i = 0; i < g.n; ++i)
  {
    const float cloud = clamp01(0.35f + 0.9f * noise[i]);
    s->r[i] = mix(0.62f, 0.93f, cloud);
    s->g[i] = mix(0.74f, 0.94f, cloud);
    s->b[i] = mix(0.92f, 0.96f, cloud);
  }
}

}  // namespace

namespace
{

/// Light that the air scatters towards the camera.
PI_SIMULATION_VECTORISED void addHaze(float half_m, const RayGroup& g, Surface* s)
{
  for (int i = 0; i < g.n; ++i)
  {
    const float air = g.t[i] / (g.t[i] + half_m);
    s->r[i] = mix(s->r[i] * s->light[i], 0.72f, air);
    s->g[i] = mix(s->g[i] * s->light[i], 0.78f, air);
    s->b[i] = mix(s->b[i] * s->light[i], 0.86f, air);
    s->light[i] = 1.0f;
  }
}

/// Colours the points where a group's rays end.
void shadeGroup(const Scene& scene, const MovingScene& moving, int32_t id, const Eigen::Vector3f& origin,
                const RayGroup& group, Surface* surface)
{
  if (id == RayPacket::SKY)
  {
    shadeSky(scene.seed, group, surface);
    return;
  }
  const auto index = static_cast<size_t>(id);
  const Primitive& primitive =
      index < scene.primitives.size() ? scene.primitives[index] : moving.primitives[index - scene.primitives.size()];
  makeSurface(scene, moving, primitive, origin, group, surface);
  applyMaterial(scene, primitive, surface);
  if (scene.haze_m > 0.0f)
  {
    addHaze(scene.haze_m, group, surface);
  }
}

}  // namespace

void shade(const Scene& scene, const MovingScene& moving, bool quick, RayPacket* packet)
{
  Surface surface;
  surface.quick = quick;
  if (allHit(*packet, packet->hit[0]))
  {
    RayGroup group;
    gatherAll(*packet, &group);
    shadeGroup(scene, moving, packet->hit[0], packet->origin, group, &surface);
    colourAll(surface, packet);
    return;
  }
  const LanesByHit by_hit(*packet);
  for (int i = 0; i < by_hit.count(); ++i)
  {
    const RayGroup group = by_hit.gather(*packet, i);
    shadeGroup(scene, moving, by_hit.id(i), packet->origin, group, &surface);
    for (int k = 0; k < group.lanes; ++k)
    {
      const int lane = group.lane[k];
      packet->r[lane] = surface.r[k] * surface.light[k];
      packet->g[lane] = surface.g[k] * surface.light[k];
      packet->b[lane] = surface.b[k] * surface.light[k];
      packet->face[lane] = surface.face[k];
    }
  }
}

}  // namespace pi_simulation::synthetic
