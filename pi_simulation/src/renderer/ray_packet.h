#pragma once

#include "renderer/frustum.h"
#include "renderer/scene.h"
#include "renderer/texture.h"

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace pi_simulation::synthetic
{

/// Own tracer and not Embree: pictures must be bit-equal on every processor, with and without fused multiply-add.
/// Rays of neighbouring pixels from one point, traced together: objects beside all of them are skipped once (Boulos,
/// Wald and Shirley 2006; frustum of a tile as in Reshetov, Soupikov and Hurley 2005).
struct alignas(64) RayPacket
{
  static constexpr int32_t SKY = -1;
  static constexpr float FAR_M = 1e4f;

  // In.
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();  ///< world [m]
  float dx[LANES];                                   ///< unit directions in the world; all LANES must be set
  float dy[LANES];
  float dz[LANES];
  float spread[LANES];  ///< angle between neighbouring rays [rad]

  // Out.
  float t[LANES];       ///< distance along the ray [m]; FAR_M: sky
  int32_t hit[LANES];   ///< index of the primitive, those of MovingScene after those of Scene; SKY
  int32_t face[LANES];  ///< as in Surface
  float r[LANES];       ///< radiance; 1: white in full light
  float g[LANES];
  float b[LANES];
};

/// Primitives that the rays of a block of pixels may hit, found once for the packets of the block. Keeps its memory.
struct Candidates
{
  struct Entry
  {
    float squared_distance;  ///< from the rays' origin to the bounds [m^2]
    int32_t id;              ///< as in RayPacket::hit
    const Primitive* primitive;
    const Bounds* bounds;
  };
  std::vector<Entry> entries;  ///< nearest first

  /// @param frustum  around all rays of the block. The scenes must outlive the candidates.
  void find(const Scene& scene, const MovingScene& moving, const Frustum& frustum);
};

/// Finds the first hit of each ray. Sets t and hit.
/// @param frustum  around the rays of the packet, within that of the candidates.
void trace(const Scene& scene, const Candidates& candidates, const Frustum& frustum, RayPacket* packet);

/// Sets bit i of the result if ray i would hit `object` with nothing else in the way. Overwrites t and hit.
uint64_t silhouette(const Candidates& candidates, const Frustum& frustum, int32_t object, RayPacket* packet);

/// Colours the rays after trace(). Sets face, r, g, b.
/// @param quick  cheaper random detail, as in Surface.
void shade(const Scene& scene, const MovingScene& moving, bool quick, RayPacket* packet);

/// Reflectance of a primitive's texture at the points of a surface; may also change its light. In materials.cpp.
void applyMaterial(const Scene& scene, const Primitive& primitive, Surface* surface);

}  // namespace pi_simulation::synthetic
