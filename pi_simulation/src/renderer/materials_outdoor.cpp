#include "renderer/materials.h"

namespace pi_simulation::synthetic
{

namespace
{

const Rgb PAINT(0.86f, 0.86f, 0.82f);

/// Where on the road each point lies, and the pixel's width across and along it.
struct alignas(64) RoadLanes
{
  float lateral[LANES];
  float along[LANES];
  float w_lateral[LANES];
  float w_along[LANES];
};

PI_SIMULATION_VECTORISED void locate(const RoadMap& road, const Surface& s, RoadLanes* __restrict lanes)
{
  RoadMap::Places places;
  road.locate(s.u, s.v, s.n, &places);
  for (int i = 0; i < s.n; ++i)
  {
    lanes->lateral[i] = places.lateral[i];
    lanes->along[i] = places.along[i];
    const float dx = std::min(std::abs(places.dx[i]), 1.0f);
    const float dy = std::min(std::abs(places.dy[i]), 1.0f);
    lanes->w_lateral[i] = std::max(dx * s.wu[i] + dy * s.wv[i], 1e-4f);
    lanes->w_along[i] = std::max(dy * s.wu[i] + dx * s.wv[i], 1e-4f);
  }
}

/// Grass, and tar with rectangular repairs.
PI_SIMULATION_VECTORISED void paintGroundBase(const float* detail, const RoadLanes& road, Surface* s)
{
  for (int i = 0; i < s->n; ++i)
  {
    const float tar_weight = pulse(road.lateral[i], -10.0f, 3.0f, road.w_lateral[i]);
    const float x = s->u[i] / 2.6f;
    const float y = s->v[i] / 2.6f;
    const int cx = floorInt(x);
    const int cy = floorInt(y);
    const float size = 0.25f + 0.6f * cellRandom(cx, cy, 17u);
    const float repair = pulse(x - static_cast<float>(cx), 0.1f, 0.1f + size, s->wu[i] / 2.6f) *
                         pulse(y - static_cast<float>(cy), 0.1f, 1.1f - size, s->wv[i] / 2.6f);
    const float tone = repair * (cellRandom(cx, cy, 18u) < 0.4f ? -0.10f : 0.0f);
    const float tar = std::max(0.43f + 0.6f * tone + 0.13f * detail[i], 0.04f);
    const float grass = std::max(0.38f + 0.24f * detail[i], 0.05f);
    paint(s, i, {0.80f, 1.0f, 0.46f}, grass);
    cover(s, i, {1.0f, 1.0f, 1.03f}, tar, tar_weight);
  }
}

/// Lines and crossings.
PI_SIMULATION_VECTORISED void paintRoadMarks(const float* detail, const RoadLanes& road, Surface* s)
{
  for (int i = 0; i < s->n; ++i)
  {
    const float across = road.lateral[i];
    const float along = road.along[i];
    const float wl = road.w_lateral[i];
    const float wa = road.w_along[i];
    const float edge = pulse(across, 2.60f, 2.75f, wl);
    const float centre = pulse(across, -0.07f, 0.07f, wl) * pulseTrain(along, 4.0f, 2.0f, wa);
    const float crossing = pulseTrain(along + 19.0f, 28.0f, 3.0f, wa) * pulseTrain(across + 0.25f, 1.0f, 0.5f, wl) *
                           pulse(across, -1.0f, 2.5f, wl);
    const float worn = clamp01(0.95f + 0.5f * detail[i]);
    cover(s, i, PAINT, 1.0f + 0.2f * detail[i], worn * std::min(edge + centre + crossing, 1.0f));
  }
}

/// Kerb stones and the slabs of the pavement.
PI_SIMULATION_VECTORISED void paintPavement(const float* detail, const RoadLanes& road, Surface* s)
{
  for (int i = 0; i < s->n; ++i)
  {
    const float across = road.lateral[i];
    const float wl = road.w_lateral[i];
    const int slab_x = floorInt(s->u[i] / 0.6f);
    const int slab_y = floorInt(s->v[i] / 0.6f);
    const float w = std::max(s->wu[i], s->wv[i]);
    const float slab_tone = fade(0.6f, w) * (cellRandom(slab_x, slab_y, 5u) - 0.5f);
    const float joints =
        std::max(pulseTrain(s->u[i], 0.6f, 0.02f, s->wu[i]), pulseTrain(s->v[i], 0.6f, 0.02f, s->wv[i]));
    const float pavement = pulse(across, 3.25f, 5.6f, wl);
    cover(s, i, {1.0f, 0.98f, 0.94f}, (0.62f + 0.18f * slab_tone + 0.2f * detail[i]) * (1.0f - 0.6f * joints),
          pavement);
    const float kerb_joint = pulseTrain(road.along[i], 0.9f, 0.025f, road.w_along[i]);
    cover(s, i, {1.0f, 1.0f, 0.97f}, (0.72f + 0.2f * detail[i]) * (1.0f - 0.7f * kerb_joint),
          pulse(across, 3.0f, 3.25f, wl));
  }
}

/// How near to the centre line and how far from it the pixels of a surface reach [m].
struct Reach
{
  float nearest;
  float farthest;
};

PI_SIMULATION_VECTORISED Reach reachOf(const RoadLanes& road, int n)
{
  float nearest[8];
  float farthest[8];
  std::fill(nearest, nearest + 8, 1e30f);
  std::fill(farthest, farthest + 8, -1e30f);
  for (int i = 0; i < n; i += 8)
  {
    for (int k = 0; k < 8; ++k)
    {
      nearest[k] = std::min(nearest[k], road.lateral[i + k] - 0.5f * road.w_lateral[i + k]);
      farthest[k] = std::max(farthest[k], road.lateral[i + k] + 0.5f * road.w_lateral[i + k]);
    }
  }
  return {*std::min_element(nearest, nearest + 8), *std::max_element(farthest, farthest + 8)};
}

/// Bricks in courses; 1 where there is mortar.
struct Bricks
{
  float mortar;
  float tone;  ///< of each brick, in [-0.5, 0.5], 0 far away
};

inline Bricks bricks(float u, float v, float wu, float wv, uint32_t seed)
{
  constexpr float LENGTH = 0.25f;
  constexpr float HEIGHT = 0.083f;
  constexpr float JOINT = 0.012f;
  const int course = floorInt(v / HEIGHT);
  const float shifted = u + 0.5f * LENGTH * static_cast<float>(course & 1);
  const float near = fade(LENGTH, std::max(wu, wv));
  return {std::max(pulseTrain(v, HEIGHT, JOINT, wv), near * pulseTrain(shifted, LENGTH, JOINT, wu)),
          near * fade(HEIGHT, wv) * (cellRandom(floorInt(shifted / LENGTH), course, seed) - 0.5f)};
}

/// Wall without its openings: brick, slabs of concrete, or plaster, by the seed.
PI_SIMULATION_VECTORISED void paintOuterWall(const Primitive& p, const float* detail, Surface* s)
{
  const Rgb color(p.color);
  const uint32_t style = p.seed % 3u;
  const float brick_weight = style == 0 ? 1.0f : 0.0f;
  const float slab_weight = style == 1 ? 0.6f : 0.0f;
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] + 100.0f;
    const float v = s->v[i] + 100.0f;
    const Bricks b = bricks(u, v, s->wu[i], s->wv[i], p.seed);
    const float joints = std::max(pulseTrain(u, 1.2f, 0.02f, s->wu[i]), pulseTrain(v, 0.8f, 0.02f, s->wv[i]));
    const float slab = cellRandom(floorInt(u / 1.2f), floorInt(v / 0.8f), p.seed + 3u) - 0.5f;
    const float tone = 1.0f + 0.2f * detail[i] + brick_weight * 0.35f * b.tone + slab_weight * 0.2f * slab;
    paint(s, i, color, std::max(tone * (1.0f - slab_weight * joints), 0.05f));
    cover(s, i, {0.66f, 0.65f, 0.62f}, 1.0f + 0.3f * detail[i], brick_weight * b.mortar);
  }
}

/// Windows in a grid, doors in the lowest row.
PI_SIMULATION_VECTORISED void paintOpenings(const Primitive& p, const float* detail, Surface* s)
{
  const Rgb accent(p.accent);
  const float storey = 3.0f + 0.4f * cellRandom(1, 1, p.seed);
  const float pitch = 1.9f + 1.2f * cellRandom(2, 1, p.seed);
  const float half_width = 0.28f * pitch;
  for (int i = 0; i < s->n; ++i)
  {
    const float height = s->v[i] + p.half.z();
    const int row = floorInt(height / storey);
    const float y = height - storey * static_cast<float>(row);
    const int column = floorInt(s->u[i] / pitch);
    const float x = s->u[i] - pitch * (static_cast<float>(column) + 0.5f);
    const float wu = s->wu[i];
    const float wv = s->wv[i];
    const bool door = (row == 0) & (cellRandom(column, 7, p.seed) < 0.35f);
    const float low = door ? 0.05f : 0.95f;
    const float high = door ? 2.2f : 2.45f;
    const float upright = s->face[i] < 4 ? 1.0f : 0.0f;
    const float frame = upright * pulse(x, -half_width, half_width, wu) * pulse(y, low, high, wv);
    const float pane =
        frame * pulse(x, 0.08f - half_width, half_width - 0.08f, wu) * pulse(y, low + 0.08f, high - 0.08f, wv);
    const float bars = std::max(pulse(x, -0.03f, 0.03f, wu), pulse(y, low + 0.9f, low + 0.96f, wv));
    const float glass = 0.10f + 0.35f * cellRandom(column, row, p.seed + 9u);
    const float curtain = cellRandom(column, row, p.seed + 11u);
    const float drawn = pulse(y, high - 1.4f * curtain, high, wv) * (curtain > 0.4f ? 1.0f : 0.0f);
    cover(s, i, accent, 1.0f + 0.2f * detail[i], frame);
    cover(s, i, {0.85f, 0.95f, 1.1f}, glass, pane * (1.0f - bars));
    cover(s, i, {0.8f, 0.76f, 0.66f}, 1.0f + 0.4f * detail[i], 0.8f * pane * drawn * (door ? 0.0f : 1.0f));
    const float sill = upright * pulse(x, -half_width - 0.1f, half_width + 0.1f, wu) * pulse(y, low - 0.12f, low, wv) *
                       (door ? 0.0f : 1.0f);
    cover(s, i, accent, 0.8f, sill);
    cover(s, i, accent, 0.9f + 0.4f * detail[i], upright * pulse(y, 0.0f, 0.14f, wv));
  }
}

}  // namespace

void paintStreet(const Scene& scene, Surface* s)
{
  float detail[LANES];
  float gravel[LANES];
  fractalNoise(*s, {1.3f, 5, 0.8f, 1.0f, scene.seed + 1u}, detail);
  fractalNoise(*s, {0.05f, 4, 0.9f, 1.0f, scene.seed + 2u}, gravel);
  for (int i = 0; i < s->n; ++i)
  {
    detail[i] = 0.6f * detail[i] + 0.8f * gravel[i];
  }
  RoadLanes road;
  locate(scene.road, *s, &road);
  paintGroundBase(detail, road, s);
  const Reach reach = reachOf(road, s->n);
  if (reach.nearest < 2.76f)
  {
    paintRoadMarks(detail, road, s);
  }
  if (reach.farthest > 2.99f)
  {
    paintPavement(detail, road, s);
  }
}

void paintFacade(const Primitive& p, Surface* s)
{
  float detail[LANES];
  fractalNoise(*s, {1.3f, 9, 0.8f, 1.0f, p.seed}, detail);
  paintOuterWall(p, detail, s);
  paintOpenings(p, detail, s);
}

/// Body of a car: gaps of doors, dirt, plates with letters at its ends.
void paintCar(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  float dirt[LANES];
  fractalNoise(*s, {0.5f, 7, 0.75f, 1.0f, p.seed}, dirt);
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i];
    const float v = s->v[i];
    const bool end = s->face[i] < 2;
    const bool side = !end && s->face[i] < 4;
    paint(s, i, color, 1.0f + 0.25f * dirt[i] - 0.25f * pulse(v, -2.0f, -0.12f, s->wv[i]));
    const float gaps = side ? std::max(pulseTrain(u + 1.4f, 1.05f, 0.025f, s->wu[i]), pulse(v, 0.1f, 0.13f, s->wv[i]))
                            : pulse(v, -0.1f, -0.07f, s->wv[i]);
    cover(s, i, {0.05f, 0.05f, 0.05f}, 1.0f, gaps);
    const float lamps = end ? pulse(std::abs(u), 0.55f, 0.8f, s->wu[i]) * pulse(v, 0.02f, 0.2f, s->wv[i]) : 0.0f;
    cover(s, i, Rgb(p.accent), 1.0f, lamps);
    if (end)
    {
      const float plate = pulse(u, -0.28f, 0.28f, s->wu[i]) * pulse(v, -0.28f, -0.14f, s->wv[i]);
      cover(s, i, PAINT, 1.0f, plate);
      const float text = textCoverage(u + 5.0f, v + 0.262f, widest(*s, i), 0.1f, p.seed);
      cover(s, i, {0.05f, 0.05f, 0.1f}, 1.0f, plate * text);
    }
  }
}

/// Windows of a car between thin posts, with a blurred sky in them.
PI_SIMULATION_VECTORISED void paintGlass(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  float reflection[LANES];
  fractalNoise(*s, {0.6f, 4, 0.6f, 1.0f, p.seed}, reflection);
  for (int i = 0; i < s->n; ++i)
  {
    const float posts = s->face[i] < 4 ? pulseTrain(s->u[i] + 10.04f, 0.9f, 0.08f, s->wu[i]) : 1.0f;
    paint(s, i, {0.8f, 0.9f, 1.0f}, std::max(0.18f + 0.22f * reflection[i], 0.04f));
    cover(s, i, color, 1.0f + 0.2f * reflection[i], posts);
  }
}

/// Leaves: dark gaps between clumps of bright ones.
PI_SIMULATION_VECTORISED void paintFoliage(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  float leaves[LANES];
  fractalNoise(*s, {0.22f, 6, 0.85f, 1.0f, p.seed}, leaves);
  for (int i = 0; i < s->n; ++i)
  {
    paint(s, i, color, 0.55f + 1.1f * clamp01(0.45f + 0.7f * leaves[i]));
  }
}

}  // namespace pi_simulation::synthetic
