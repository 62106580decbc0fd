#pragma once

// Building blocks of the procedural textures. Each is band-limited: it takes the width of a pixel on the surface and
// leaves out what is finer (Norton, Rockwood and Skolmoski, "Clamping", SIGGRAPH 1982; box-filtered steps as in Apodaca
// and Gritz, Advanced RenderMan, ch. 11). Functions of one point are free of branches, so that loops over the points of
// a Surface become vector code.

#include <algorithm>
#include <cmath>
#include <cstdint>

/// Compiles a function twice, for AVX2 and for any x86-64, and picks one when the program starts. Both round alike, as
/// neither may contract to fused multiply-add. On other processors the compiler's own vector code serves.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define PI_SIMULATION_VECTORISED __attribute__((target_clones("avx2", "default")))
#else
#define PI_SIMULATION_VECTORISED
#endif

namespace pi_simulation::synthetic
{

constexpr int LANES = 64;  ///< points or rays that are worked on together; 8x8 pixels

/// Points on one primitive, with texture coordinates in metres.
struct alignas(64) Surface
{
  int n = 0;            ///< points, rounded up to a multiple of 8 with copies of the first
  bool quick = false;   ///< RenderQuality::LIVE
  float u[LANES];       ///< along the surface [m]: to the right seen from outside on upright faces
  float v[LANES];       ///< up on upright faces [m]; 0 at the primitive's centre
  float wu[LANES];      ///< width of the pixel on the surface, along u [m]
  float wv[LANES];      ///< along v [m]
  float light[LANES];   ///< light that the surface gets, 1: full
  int32_t face[LANES];  ///< box: 0 -x, 1 +x, 2 -y, 3 +y, 4 -z, 5 +z; cylinder: 0 side, 4 and 5 caps; else 0
  float r[LANES];       ///< result: reflectance
  float g[LANES];
  float b[LANES];
};

/// Largest integer not above x, for |x| < 2^31, in vector code on every processor.
inline int floorInt(float x)
{
  const int i = static_cast<int>(x);
  return i - static_cast<int>(static_cast<float>(i) > x);
}

inline float fraction(float x)
{
  return x - static_cast<float>(floorInt(x));
}

inline float clamp01(float x)
{
  const float low = x > 0.0f ? x : 0.0f;
  return low < 1.0f ? low : 1.0f;
}

inline float mix(float a, float b, float weight)
{
  return a + weight * (b - a);
}

/// Integer hash of a lattice point: two rounds of multiply and xor-shift.
inline uint32_t hashCell(int x, int y, uint32_t seed)
{
  uint32_t h = static_cast<uint32_t>(x) * 0x9E3779B1u ^ static_cast<uint32_t>(y) * 0x85EBCA77u ^ seed;
  h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
  h = (h ^ (h >> 13)) * 0x297A2D39u;
  return h ^ (h >> 16);
}

/// Rows and columns of a lattice for quickRandom().
inline uint32_t quickKey(int coordinate, uint32_t factor)
{
  return static_cast<uint32_t>(coordinate) * factor;
}

/// Random number in [0, 1) from a lattice point's keys: one round of multiply and xor-shift, enough for noise.
inline float quickRandom(uint32_t key)
{
  const uint32_t h = (key ^ (key >> 15)) * 0x2C1B3C6Du;
  return static_cast<float>(static_cast<int32_t>((h ^ (h >> 13)) & 0xFFFFFFu)) * 0x1p-24f;
}

/// Random number in [0, 1) of a lattice point.
inline float cellRandom(int x, int y, uint32_t seed)
{
  return static_cast<float>(static_cast<int32_t>(hashCell(x, y, seed) >> 8)) * 0x1p-24f;
}

/// Part of a pixel [x - w/2, x + w/2] that lies in [a, b].
inline float pulse(float x, float a, float b, float w)
{
  const float high = std::min(x + 0.5f * w, b);
  const float low = std::max(x - 0.5f * w, a);
  return clamp01((high - low) / w);
}

/// The same for pulses [k period, k period + length] of all k.
inline float pulseTrain(float x, float period, float length, float w)
{
  const float scale = 1.0f / period;
  const float duty = length * scale;
  const float low = (x - 0.5f * w) * scale;
  const float high = (x + 0.5f * w) * scale;
  const auto low_cell = static_cast<float>(floorInt(low));
  const auto high_cell = static_cast<float>(floorInt(high));
  const float integral =
      (high_cell - low_cell) * duty + std::min(high - high_cell, duty) - std::min(low - low_cell, duty);
  return clamp01(integral / (w * scale));
}

/// Weight of detail of a size beside a pixel of width w: 1 for much larger, 0 from 1.5 pixels on downwards.
inline float fade(float size, float w)
{
  return clamp01(1.4f - 1.4f * w / (1.5f * size));
}

/// Disc of radius `radius` around the centre.
inline float disc(float x, float y, float radius, float w)
{
  return clamp01(0.5f + (radius - std::sqrt(x * x + y * y)) / w);
}

struct NoiseSpec
{
  float cell = 1.0f;         ///< size of the coarsest lattice cell [m]
  int octaves = 6;           ///< each half as fine as the one before
  float persistence = 0.8f;  ///< amplitude of an octave relative to the one before
  float stretch = 1.0f;      ///< cells are this much longer along v
  uint32_t seed = 0;
};

/// Sum of octaves of value noise at all points of a surface (Perlin 1985; value noise on a hashed lattice), about 0
/// with a standard deviation near 0.35. Octaves finer than the pixels are faded out. Quick surfaces get other, cheaper
/// random numbers, and lack octaves that are hardly to be seen.
void fractalNoise(const Surface& surface, const NoiseSpec& spec, float* out);

/// Coverage by ink of the letter in an upright cell of 6 x 8 units at point (x, y), y up, of pixels w wide. Letters and
/// digits are 5 x 7.
float letterCoverage(uint32_t letter, float x, float y, float w);

/// Rows of random letters, `height` high, without end; the part in ink of pixel (u, v).
float textCoverage(float u, float v, float w, float height, uint32_t seed);

}  // namespace pi_simulation::synthetic
