#include "renderer/materials.h"

namespace pi_simulation::synthetic
{

namespace
{

const Rgb CONCRETE(0.58f, 0.57f, 0.55f);
const Rgb TILE(0.50f, 0.49f, 0.46f);
const Rgb DARK(0.07f, 0.07f, 0.08f);

/// Walls: slabs of concrete with bolt holes, a painted lower part, a cable duct.
PI_SIMULATION_VECTORISED void paintWalls(const Primitive& p, const float* detail, Surface* s)
{
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] + 100.0f;
    const float v = s->v[i] + p.half.z();
    const int column = floorInt(u / 1.8f);
    const int row = floorInt(v / 1.4f);
    const float x = u - 1.8f * static_cast<float>(column);
    const float y = v - 1.4f * static_cast<float>(row);
    const float w = std::max(s->wu[i], s->wv[i]);
    const float slab = cellRandom(column + 100 * (s->face[i] + 1), row, p.seed) - 0.5f;
    const float joints = std::max(pulse(x, 0.0f, 0.025f, s->wu[i]), pulse(y, 0.0f, 0.025f, s->wv[i]));
    const float hole = disc(std::abs(x - 0.9f) - 0.6f, std::abs(y - 0.7f) - 0.45f, 0.03f, w) * fade(0.06f, w);
    paint(s, i, CONCRETE, std::max(1.0f + 0.35f * slab + 0.6f * detail[i], 0.1f));
    const float lower = pulse(v, -1.0f, 1.15f, s->wv[i]);
    cover(s, i, Rgb(0.33f, 0.42f, 0.40f), 1.0f + 0.5f * detail[i] + 0.2f * slab, 0.85f * lower);
    cover(s, i, DARK, 1.0f, std::min(0.8f * joints + hole, 1.0f));
    const float duct = pulse(v, 2.55f, 2.67f, s->wv[i]);
    cover(s, i, Rgb(0.7f, 0.7f, 0.72f), 1.0f + 0.3f * detail[i], duct * (1.0f - pulseTrain(u, 0.5f, 0.04f, s->wu[i])));
  }
}

/// Floor: tiles with stains and yellow lines.
PI_SIMULATION_VECTORISED void paintFloor(const Primitive& p, const float* detail, Surface* s)
{
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] + 100.0f;
    const float v = s->v[i] + 100.0f;
    const float w = std::max(s->wu[i], s->wv[i]);
    const float tile = fade(0.6f, w) * (cellRandom(floorInt(u / 0.6f), floorInt(v / 0.6f), p.seed) - 0.5f);
    const float joints = std::max(pulseTrain(u, 0.6f, 0.015f, s->wu[i]), pulseTrain(v, 0.6f, 0.015f, s->wv[i]));
    const float lines = std::max(pulseTrain(u, 5.3f, 0.12f, s->wu[i]), pulseTrain(v, 6.1f, 0.12f, s->wv[i]));
    paint(s, i, TILE, std::max(1.0f + 0.6f * tile + 0.6f * detail[i], 0.1f));
    cover(s, i, DARK, 2.0f, 0.7f * joints);
    cover(s, i, Rgb(0.80f, 0.66f, 0.15f), 1.0f + 0.5f * detail[i], clamp01(0.9f + 0.6f * detail[i]) * lines);
  }
}

/// Ceiling: sheets between beams, lamps that shine.
PI_SIMULATION_VECTORISED void paintCeiling(const Primitive& p, const float* detail, Surface* s)
{
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] + 100.0f;
    const float v = s->v[i] + 100.0f;
    const float w = std::max(s->wu[i], s->wv[i]);
    const float sheet = fade(1.2f, w) * (cellRandom(floorInt(u / 1.2f), floorInt(v / 0.6f), p.seed) - 0.5f);
    const float joints = std::max(pulseTrain(u, 1.2f, 0.02f, s->wu[i]), pulseTrain(v, 0.6f, 0.02f, s->wv[i]));
    const float beams = pulseTrain(v, 3.0f, 0.25f, s->wv[i]);
    const float lamps = pulseTrain(u, 2.4f, 1.2f, s->wu[i]) * pulseTrain(v + 1.8f, 3.0f, 0.3f, s->wv[i]);
    const float shade = 0.75f + 0.25f * sheet + 0.35f * detail[i];
    paint(s, i, CONCRETE, std::max(shade, 0.1f));
    cover(s, i, DARK, 1.5f, 0.6f * joints);
    cover(s, i, Rgb(0.25f, 0.27f, 0.32f), 1.0f + 0.6f * detail[i], beams);
    cover(s, i, Rgb(1.0f, 1.0f, 0.95f), 1.0f / s->light[i], lamps);
  }
}

using PaintShell = void (*)(const Primitive&, const float*, Surface*);

/// Paints the points on faces `first` to `last` and leaves the others as they are.
/// @return false if there is no such point.
bool paintFaces(int first, int last, const Primitive& p, const float* detail, PaintShell paint_shell, Surface* s)
{
  const auto wanted = [&](int i) { return s->face[i] >= first && s->face[i] <= last; };
  bool any = false;
  for (int i = 0; i < s->n; ++i)
  {
    any = any || wanted(i);
  }
  if (!any)
  {
    return false;
  }
  Surface painted = *s;
  paint_shell(p, detail, &painted);
  for (int i = 0; i < s->n; ++i)
  {
    if (wanted(i))
    {
      s->r[i] = painted.r[i];
      s->g[i] = painted.g[i];
      s->b[i] = painted.b[i];
    }
  }
  return true;
}

}  // namespace

void paintHallShell(const Primitive& p, Surface* s)
{
  float detail[LANES];
  fractalNoise(*s, {1.5f, 9, 0.84f, 1.0f, p.seed}, detail);
  // Most packets see one of the three only.
  const bool floor = paintFaces(4, 4, p, detail, paintFloor, s);
  const bool ceiling = paintFaces(5, 5, p, detail, paintCeiling, s);
  if (!floor && !ceiling)
  {
    paintWalls(p, detail, s);
  }
  else
  {
    paintFaces(0, 3, p, detail, paintWalls, s);
  }
}

/// Open compartments with a box of random size, tone and label in most of them.
void paintShelf(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  constexpr float WIDTH = 0.62f;
  constexpr float HEIGHT = 0.46f;
  float detail[LANES];
  fractalNoise(*s, {0.4f, 8, 0.8f, 1.0f, p.seed}, detail);
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] + 50.0f;
    const float v = s->v[i] + p.half.z();
    const int column = floorInt(u / WIDTH);
    const int row = floorInt(v / HEIGHT);
    const float x = u - WIDTH * static_cast<float>(column);
    const float y = v - HEIGHT * static_cast<float>(row);
    const float wide = 0.25f + 0.3f * cellRandom(column, row, p.seed);
    const float tall = 0.12f + 0.26f * cellRandom(column, row, p.seed + 1u);
    const float tone = 0.2f + 0.75f * cellRandom(column, row, p.seed + 2u);
    const float item = pulse(x, 0.05f, 0.05f + wide, s->wu[i]) * pulse(y, 0.04f, 0.04f + tall, s->wv[i]);
    paint(s, i, {0.11f, 0.11f, 0.12f}, 1.0f + 0.5f * detail[i]);
    cover(s, i, {1.0f, mix(0.75f, 1.0f, cellRandom(row, column, p.seed)), 0.7f}, tone * (1.0f + 0.4f * detail[i]),
          item);
    const float label = pulse(x, 0.09f, 0.01f + wide, s->wu[i]) * pulse(y, 0.08f, 0.16f, s->wv[i]);
    if (label > 0.0f)
    {
      const float text = textCoverage(u, y - 0.09f, widest(*s, i), 0.06f, p.seed + static_cast<uint32_t>(row));
      cover(s, i, {0.9f, 0.9f, 0.88f}, 1.0f - 0.9f * text, label);
    }
    const float frame = std::max(pulse(x, -0.04f, 0.04f, s->wu[i]), pulse(y, -0.03f, 0.03f, s->wv[i]));
    cover(s, i, color, 1.0f + 0.3f * detail[i], frame);
  }
}

/// Boards with grain, nails and a stamp.
void paintCrate(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  float grain[LANES];
  Surface turned = *s;  // the grain runs along u
  std::swap(turned.u, turned.v);
  std::swap(turned.wu, turned.wv);
  fractalNoise(turned, {0.09f, 6, 0.8f, 7.0f, p.seed}, grain);
  for (int i = 0; i < s->n; ++i)
  {
    const float v = s->v[i] + 20.0f;
    const int board = floorInt(v / 0.14f);
    const float tone = 0.8f + 0.4f * cellRandom(board, s->face[i], p.seed);
    paint(s, i, color, std::max(tone * (1.0f + 0.7f * grain[i]), 0.1f));
    cover(s, i, DARK, 1.0f, pulseTrain(v, 0.14f, 0.015f, s->wv[i]));
    const float nail_x = fraction((s->u[i] + 20.0f) / 0.5f) * 0.5f - 0.25f;
    const float nail_y = v - 0.14f * (static_cast<float>(board) + 0.5f);
    const float w = widest(*s, i);
    cover(s, i, DARK, 1.0f, disc(nail_x, nail_y, 0.012f, w) * fade(0.03f, w));
    const float stamp = pulse(s->u[i], -0.6f * p.half.y(), 0.6f * p.half.y(), s->wu[i]) *
                        pulse(s->v[i], -0.25f * p.half.z(), 0.35f * p.half.z(), s->wv[i]);
    if (stamp > 0.0f)
    {
      const float text = textCoverage(s->u[i], s->v[i] + 0.25f * p.half.z(), w, 0.16f, p.seed);
      cover(s, i, {0.12f, 0.08f, 0.06f}, 1.0f, 0.85f * stamp * text);
    }
  }
}

/// Sheet metal with seams, rivets, dials and type plates.
void paintMachine(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  constexpr float PANEL = 0.55f;
  float detail[LANES];
  fractalNoise(*s, {0.5f, 8, 0.8f, 1.0f, p.seed}, detail);
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] + 30.0f;
    const float v = s->v[i] + 30.0f;
    const int column = floorInt(u / PANEL);
    const int row = floorInt(v / PANEL);
    const float x = u - PANEL * (static_cast<float>(column) + 0.5f);
    const float y = v - PANEL * (static_cast<float>(row) + 0.5f);
    const float w = widest(*s, i);
    const float kind = cellRandom(column, row, p.seed + 1u);
    const float tone = 0.85f + 0.3f * cellRandom(column, row, p.seed);
    paint(s, i, color, std::max(tone * (1.0f + 0.5f * detail[i]), 0.08f));
    const float seam = std::max(pulse(std::abs(x), 0.265f, 0.3f, s->wu[i]), pulse(std::abs(y), 0.265f, 0.3f, s->wv[i]));
    const float rivet = disc(std::abs(x) - 0.23f, std::abs(y) - 0.23f, 0.014f, w) * fade(0.03f, w);
    cover(s, i, DARK, 1.0f, std::min(seam + rivet, 1.0f));
    const float dial = kind < 0.3f ? disc(x, y, 0.15f, w) : 0.0f;
    cover(s, i, Rgb(p.accent), 1.0f, dial);
    const float angle = 6.28f * cellRandom(row, column, p.seed);
    const float needle = pulse(x * std::sin(angle) - y * std::cos(angle), -0.012f, 0.012f, w);
    cover(s, i, DARK, 1.0f, dial * needle);
    const float slots = kind > 0.7f ? pulse(x, -0.2f, 0.2f, s->wu[i]) * pulse(y, -0.2f, 0.2f, s->wv[i]) *
                                          pulseTrain(y + 1.0f, 0.05f, 0.025f, s->wv[i])
                                    : 0.0f;
    cover(s, i, DARK, 1.0f, slots);
    const bool plated = kind >= 0.3f && kind < 0.5f;
    const float plate = plated ? pulse(x, -0.2f, 0.2f, s->wu[i]) * pulse(y, -0.07f, 0.07f, s->wv[i]) : 0.0f;
    const float text = plated ? textCoverage(u, y + 0.05f, w, 0.09f, p.seed) : 0.0f;
    cover(s, i, Rgb(p.accent), 1.0f - 0.9f * text, plate);
  }
}

/// Insulation in crumpled foil, with clamps.
PI_SIMULATION_VECTORISED void paintPipe(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  float foil[LANES];
  fractalNoise(*s, {0.28f, 7, 0.88f, 1.0f, p.seed}, foil);
  for (int i = 0; i < s->n; ++i)
  {
    const float clamp = pulseTrain(s->v[i] + 40.0f, 1.1f, 0.07f, s->wv[i]);
    paint(s, i, color, std::max(1.0f + 0.9f * foil[i], 0.1f));
    cover(s, i, Rgb(p.accent), 1.0f, clamp);
  }
}

}  // namespace pi_simulation::synthetic
