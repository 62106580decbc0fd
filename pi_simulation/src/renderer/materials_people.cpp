#include "renderer/materials.h"

namespace pi_simulation::synthetic
{

namespace
{

const Rgb WHITE(0.9f, 0.9f, 0.88f);
const Rgb BLACK(0.05f, 0.05f, 0.05f);

/// Long folds, and wrinkles between them; the cloth is darker in them.
struct Folds
{
  float deep;     ///< [0, 1]
  float stretch;  ///< along the limb
  float cell;     ///< [m]
};

PI_SIMULATION_VECTORISED void paintFolds(const Primitive& p, const Folds& folds, Surface* s)
{
  const Rgb color(p.color);
  float large[LANES];
  float fine[LANES];
  fractalNoise(*s, {folds.cell, 4, 0.6f, folds.stretch, p.seed}, large);
  fractalNoise(*s, {0.012f, 2, 0.7f, 1.0f, p.seed + 1u}, fine);
  for (int i = 0; i < s->n; ++i)
  {
    const float crease = 1.0f - std::min(5.0f * std::abs(large[i]), 1.0f);  // where the noise changes its sign
    paint(s, i, color, std::max(1.0f + folds.deep * (0.3f * large[i] - 0.2f * crease) + 0.08f * fine[i], 0.1f));
  }
}

}  // namespace

/// Plain, striped, checked or with something printed on the chest.
PI_SIMULATION_VECTORISED void paintShirt(const Primitive& p, Surface* s)
{
  const Rgb accent(p.accent);
  const uint32_t pattern = p.seed % 8u;
  const float stripes = pattern == 0 || pattern == 1 ? 0.85f : 0.0f;
  const float checks = pattern == 1 ? 0.6f : 0.0f;
  const float print = pattern == 2 || pattern == 3 ? 0.9f : 0.0f;
  paintFolds(p, {0.55f, 1.6f, 0.13f}, s);
  for (int i = 0; i < s->n; ++i)
  {
    cover(s, i, accent, 1.0f, stripes * pulseTrain(s->v[i], 0.06f, 0.025f, s->wv[i]));
    cover(s, i, accent, 1.0f, checks * pulseTrain(s->u[i], 0.06f, 0.02f, s->wu[i]));
    const float board = pulse(s->u[i], -0.09f, 0.09f, s->wu[i]) * pulse(s->v[i], 0.0f, 0.14f, s->wv[i]);
    cover(s, i, accent, 1.0f, print * board * pulseTrain(s->v[i] + 1.0f, 0.05f, 0.03f, s->wv[i]));
  }
}

/// With a zip, or open over what is worn below; pockets, seams.
PI_SIMULATION_VECTORISED void paintJacket(const Primitive& p, Surface* s)
{
  const Rgb accent(p.accent);
  const Rgb color(p.color);
  const float open = p.seed % 3u == 0 ? 0.055f : 0.0f;
  paintFolds(p, {0.7f, 1.2f, 0.11f}, s);
  for (int i = 0; i < s->n; ++i)
  {
    const float u = std::abs(s->u[i]);
    cover(s, i, accent, 1.0f, open > 0.0f ? pulse(u, -1.0f, open, s->wu[i]) : 0.0f);
    cover(s, i, color, 0.45f, pulse(u, open, open + 0.012f, s->wu[i]));
    cover(s, i, color, 0.6f, pulse(u, 0.06f, 0.14f, s->wu[i]) * pulse(s->v[i], -0.11f, -0.1f, s->wv[i]));
  }
}

void paintSleeve(const Primitive& p, Surface* s)
{
  paintFolds(p, {0.6f, 0.6f, 0.08f}, s);
}

/// With a seam at the outside.
PI_SIMULATION_VECTORISED void paintTrousers(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  const float outside = 1.57f * p.half.x();
  paintFolds(p, {0.6f, 1.8f, 0.09f}, s);
  for (int i = 0; i < s->n; ++i)
  {
    cover(s, i, color, 0.7f, pulse(std::abs(s->u[i]), outside - 0.004f, outside + 0.004f, s->wu[i]));
  }
}

/// Folds that run down.
void paintSkirt(const Primitive& p, Surface* s)
{
  paintFolds(p, {0.9f, 8.0f, 0.07f}, s);
}

/// The sole is light or black. The shoe lies along the shape's z axis; its x axis points up.
PI_SIMULATION_VECTORISED void paintShoe(const Primitive& p, Surface* s)
{
  const Rgb sole = p.seed % 2u == 0 ? WHITE : BLACK;
  const float edge = 2.1f * p.half.x();
  paintRough(p, {0.04f, 3, 0.7f, 1.0f, p.seed}, 0.3f, s);
  for (int i = 0; i < s->n; ++i)
  {
    cover(s, i, sole, 1.0f, pulse(std::abs(s->u[i]), edge, 1.0f, s->wu[i]));
    cover(s, i, WHITE, 0.9f,
          0.5f * pulse(std::abs(s->u[i]), 0.0f, 0.008f, s->wu[i]) * pulseTrain(s->v[i], 0.02f, 0.01f, s->wv[i]));
  }
}

/// Eyes, brows, mouth and cheeks on an ellipsoid that looks along its x axis; the accent is the colour of the hair.
PI_SIMULATION_VECTORISED void paintFace(const Primitive& p, Surface* s)
{
  const Rgb hair(p.accent);
  const float size = p.half.z() / 0.118f;
  const float beard = p.seed % 5u == 0 ? 0.75f : 0.0f;
  const Rgb lips(0.62f * p.color.x() + 0.1f, 0.42f * p.color.y(), 0.42f * p.color.z());
  const Rgb socket(0.72f * p.color.x(), 0.66f * p.color.y(), 0.64f * p.color.z());
  paintRough(p, {0.03f, 3, 0.6f, 1.0f, p.seed}, 0.12f, s);
  for (int i = 0; i < s->n; ++i)
  {
    const float u = s->u[i] / size;
    const float v = s->v[i] / size;
    const float w = std::max(widest(*s, i) / size, 1e-4f);
    const float side = std::abs(u);
    cover(s, i, hair, 1.0f, beard * pulse(v, -0.2f, -0.028f, w) * pulse(side, -1.0f, 0.075f, w));
    cover(s, i, socket, 1.0f, 0.8f * disc((side - 0.033f) * 0.8f, v - 0.012f, 0.018f, w));
    cover(s, i, WHITE, 0.85f, disc((side - 0.033f) * 0.6f, v - 0.01f, 0.0085f, w));
    cover(s, i, BLACK, 1.0f, disc(side - 0.033f, v - 0.01f, 0.0065f, w));
    cover(s, i, hair, 0.9f, pulse(side, 0.017f, 0.052f, w) * pulse(v, 0.031f, 0.039f, w));
    cover(s, i, socket, 0.8f, 0.8f * pulse(side, -1.0f, 0.016f, w) * pulse(v, -0.032f, -0.024f, w));
    cover(s, i, lips, 1.0f, pulse(side, -1.0f, 0.025f, w) * pulse(v, -0.061f, -0.048f, w));
    cover(s, i, hair, 1.0f, pulse(v, 0.082f, 1.0f, w));
  }
}

/// Strands.
PI_SIMULATION_VECTORISED void paintHair(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  float strands[LANES];
  fractalNoise(*s, {0.025f, 3, 0.8f, 6.0f, p.seed}, strands);
  for (int i = 0; i < s->n; ++i)
  {
    paint(s, i, color, std::max(1.0f + 0.8f * strands[i], 0.2f));
  }
}

}  // namespace pi_simulation::synthetic
