#include "renderer/texture.h"

namespace pi_simulation::synthetic
{

namespace
{

constexpr uint32_t LETTERS = 36;

/// A-Z and 0-9, seven rows from the top, five bits each, the highest to the left.
constexpr uint8_t FONT[LETTERS][7] = {
    {14, 17, 17, 31, 17, 17, 17}, {30, 17, 17, 30, 17, 17, 30}, {14, 17, 16, 16, 16, 17, 14},
    {30, 17, 17, 17, 17, 17, 30}, {31, 16, 16, 30, 16, 16, 31}, {31, 16, 16, 30, 16, 16, 16},
    {14, 17, 16, 23, 17, 17, 14}, {17, 17, 17, 31, 17, 17, 17}, {14, 4, 4, 4, 4, 4, 14},
    {7, 2, 2, 2, 2, 18, 12},      {17, 18, 20, 24, 20, 18, 17}, {16, 16, 16, 16, 16, 16, 31},
    {17, 27, 21, 21, 17, 17, 17}, {17, 25, 21, 19, 17, 17, 17}, {14, 17, 17, 17, 17, 17, 14},
    {30, 17, 17, 30, 16, 16, 16}, {14, 17, 17, 17, 21, 18, 13}, {30, 17, 17, 30, 20, 18, 17},
    {15, 16, 16, 14, 1, 1, 30},   {31, 4, 4, 4, 4, 4, 4},       {17, 17, 17, 17, 17, 17, 14},
    {17, 17, 17, 17, 17, 10, 4},  {17, 17, 17, 21, 21, 27, 17}, {17, 17, 10, 4, 10, 17, 17},
    {17, 17, 10, 4, 4, 4, 4},     {31, 1, 2, 4, 8, 16, 31},     {14, 17, 19, 21, 25, 17, 14},
    {4, 12, 4, 4, 4, 4, 14},      {14, 17, 1, 6, 8, 16, 31},    {31, 2, 4, 6, 1, 17, 14},
    {2, 6, 10, 18, 31, 2, 2},     {31, 16, 30, 1, 1, 17, 14},   {6, 8, 16, 30, 17, 17, 14},
    {31, 1, 2, 4, 8, 8, 8},       {14, 17, 17, 14, 17, 17, 14}, {14, 17, 17, 15, 1, 2, 12}};

float ink(uint32_t letter, int column, int row)
{
  if (column < 0 || column > 4 || row < 0 || row > 6)
  {
    return 0.0f;
  }
  return (FONT[letter % LETTERS][6 - row] >> (4 - column) & 1) != 0 ? 1.0f : 0.0f;
}

}  // namespace

namespace
{

/// One octave of value noise at one point, in [-1, 1].
template <bool QUICK>
inline float valueNoise(float x, float y, uint32_t seed)
{
  const int ix = floorInt(x);
  const int iy = floorInt(y);
  const float fx = x - static_cast<float>(ix);
  const float fy = y - static_cast<float>(iy);
  const float sx = fx * fx * (3.0f - 2.0f * fx);
  const float sy = fy * fy * (3.0f - 2.0f * fy);
  if (QUICK)
  {
    constexpr uint32_t COLUMN = 0x9E3779B1u;
    constexpr uint32_t ROW = 0x85EBCA77u;
    const uint32_t left = quickKey(ix, COLUMN) + seed;
    const uint32_t bottom = quickKey(iy, ROW);
    const uint32_t right = left + COLUMN;
    const uint32_t top = bottom + ROW;
    const float low = mix(quickRandom(left ^ bottom), quickRandom(right ^ bottom), sx);
    const float high = mix(quickRandom(left ^ top), quickRandom(right ^ top), sx);
    return 2.0f * mix(low, high, sy) - 1.0f;
  }
  const float low = mix(cellRandom(ix, iy, seed), cellRandom(ix + 1, iy, seed), sx);
  const float high = mix(cellRandom(ix, iy + 1, seed), cellRandom(ix + 1, iy + 1, seed), sx);
  return 2.0f * mix(low, high, sy) - 1.0f;
}

struct Octave
{
  float cell;
  float stretch;
  float amplitude;
  float shift;
  uint32_t seed;
};

template <bool QUICK>
inline void addOctaveOf(const Surface& s, const Octave& octave, float* __restrict out)
{
  const float scale_u = 1.0f / octave.cell;
  const float scale_v = 1.0f / (octave.cell * octave.stretch);
  for (int i = 0; i < s.n; ++i)
  {
    const float x = s.u[i] * scale_u + octave.shift;
    const float y = s.v[i] * scale_v + octave.shift;
    const float visible = fade(octave.cell, s.wu[i]) * fade(octave.cell * octave.stretch, s.wv[i]);
    out[i] += octave.amplitude * visible * valueNoise<QUICK>(x, y, octave.seed);
  }
}

PI_SIMULATION_VECTORISED void addOctave(const Surface& s, const Octave& octave, float* __restrict out)
{
  addOctaveOf<false>(s, octave, out);
}

PI_SIMULATION_VECTORISED void addQuickOctave(const Surface& s, const Octave& octave, float* __restrict out)
{
  addOctaveOf<true>(s, octave, out);
}

PI_SIMULATION_VECTORISED float finestPixel(const Surface& s, float stretch)
{
  // Eight minima side by side, as in farthest(); n is a multiple of 8.
  float finest[8] = {1e30f, 1e30f, 1e30f, 1e30f, 1e30f, 1e30f, 1e30f, 1e30f};
  for (int i = 0; i < s.n; i += 8)
  {
    for (int k = 0; k < 8; ++k)
    {
      finest[k] = std::min(finest[k], std::max(s.wu[i + k], s.wv[i + k] / stretch));
    }
  }
  return *std::min_element(finest, finest + 8);
}

}  // namespace

void fractalNoise(const Surface& s, const NoiseSpec& spec, float* out)
{
  std::fill(out, out + s.n, 0.0f);
  const float finest = finestPixel(s, spec.stretch);
  const float limit = s.quick ? 1.15f : 1.5f;  // pixels per cell where an octave is faded out, or nearly so
  Octave o{spec.cell, spec.stretch, 0.55f, 0.0f, 0};
  for (int octave = 0; octave < spec.octaves && finest < limit * o.cell; ++octave)
  {
    o.seed = (spec.seed + static_cast<uint32_t>(octave) * 0x6C8E9CF5u) * 0x9E3779B1u;
    // Lattices of different octaves must not share their lines.
    o.shift = 0.37f * static_cast<float>(octave);
    (s.quick ? addQuickOctave : addOctave)(s, o, out);
    o.cell *= 0.5f;
    o.amplitude *= spec.persistence;
  }
}

float letterCoverage(uint32_t letter, float x, float y, float w)
{
  constexpr float MEAN_INK = 0.35f;
  const float cx = x - 0.5f;
  const float cy = y - 0.5f;
  const int ix = floorInt(cx);
  const int iy = floorInt(cy);
  const float fx = cx - static_cast<float>(ix);
  const float fy = cy - static_cast<float>(iy);
  const float low = mix(ink(letter, ix, iy), ink(letter, ix + 1, iy), fx);
  const float high = mix(ink(letter, ix, iy + 1), ink(letter, ix + 1, iy + 1), fx);
  // The bilinear ramp from paper to ink is one unit wide; a pixel narrower than that sees a steeper one.
  const float sharp = std::max(1.0f, 1.0f / w);
  const float coverage = clamp01(0.5f + (mix(low, high, fy) - 0.5f) * sharp);
  return mix(MEAN_INK, coverage, fade(1.0f, w));
}

float textCoverage(float u, float v, float w, float height, uint32_t seed)
{
  const float unit = height / 8.0f;
  const float x = u / unit;
  const float y = v / unit;
  const int column = floorInt(x / 6.0f);
  const int row = floorInt(y / 9.0f);
  const uint32_t letter = hashCell(column, row, seed);
  if (letter % 7 == 0)  // between words
  {
    return 0.0f;
  }
  return letterCoverage(letter >> 3, x - 6.0f * static_cast<float>(column), y - 9.0f * static_cast<float>(row),
                        w / unit);
}

}  // namespace pi_simulation::synthetic
