#include "renderer/materials.h"

#include "renderer/ray_packet.h"

namespace pi_simulation::synthetic
{

namespace
{

const Rgb WHITE(0.92f, 0.92f, 0.90f);
const Rgb BLACK(0.06f, 0.06f, 0.07f);

}  // namespace

PI_SIMULATION_VECTORISED void paintRough(const Primitive& p, const NoiseSpec& noise, float contrast, Surface* s)
{
  const Rgb color(p.color);
  float detail[LANES];
  fractalNoise(*s, noise, detail);
  for (int i = 0; i < s->n; ++i)
  {
    paint(s, i, color, std::max(1.0f + contrast * detail[i], 0.1f));
  }
}

/// A board, thin along x, with a frame and lines of text.
void paintSign(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  const Rgb accent(p.accent);
  const float width = p.half.y();
  const float height = p.half.z();
  const float letter = std::min(0.8f * height, 0.3f);
  paintRough(p, {0.2f, 6, 0.7f, 1.0f, p.seed}, 0.15f, s);
  for (int i = 0; i < s->n; ++i)
  {
    const float inner = pulse(s->u[i], -0.93f * width, 0.93f * width, s->wu[i]) *
                        pulse(s->v[i], -0.90f * height, 0.90f * height, s->wv[i]);
    cover(s, i, accent, 1.0f, 1.0f - inner);
    if (s->face[i] < 2)
    {
      const float text = textCoverage(s->u[i], s->v[i] + 0.4f * letter, widest(*s, i), letter, p.seed);
      cover(s, i, accent, 1.0f, inner * text);
    }
  }
}

/// A picture of coloured fields and discs above lines of small print.
void paintPoster(const Primitive& p, Surface* s)
{
  const float width = 2.0f * p.half.y();
  const float height = 2.0f * p.half.z();
  const float field = width / 4.0f;
  float detail[LANES];
  fractalNoise(*s, {0.4f, 8, 0.75f, 1.0f, p.seed}, detail);
  for (int i = 0; i < s->n; ++i)
  {
    const float x = s->u[i] + 0.5f * width;
    const float y = s->v[i] + 0.5f * height;
    const float w = widest(*s, i);
    const int column = floorInt(x / field);
    const int row = floorInt(y / field);
    const float tone = 0.25f + 0.6f * cellRandom(column, row, p.seed) + 0.25f * detail[i];
    paint(s, i, {tone, mix(0.5f, tone, p.color.y()), mix(tone, 0.5f, p.color.x())}, 1.0f);
    const float radius = field * (0.15f + 0.25f * cellRandom(row, column, p.seed + 1));
    const float spot =
        disc(x - (static_cast<float>(column) + 0.5f) * field, y - (static_cast<float>(row) + 0.5f) * field, radius, w);
    cover(s, i, Rgb(p.accent), 1.0f + 0.3f * detail[i], spot * fade(field, w));
    const float print = pulse(y, 0.0f, 0.3f * height, s->wv[i]);
    cover(s, i, WHITE, 1.0f, print);
    if (print > 0.0f)
    {
      const float line = textCoverage(x, y, w, std::max(0.05f * height, 0.04f), p.seed);
      cover(s, i, BLACK, 1.0f, print * line);
    }
    const float inner =
        pulse(x, 0.02f * width, 0.98f * width, s->wu[i]) * pulse(y, 0.02f * height, 0.98f * height, s->wv[i]);
    cover(s, i, WHITE, 1.0f, 1.0f - inner);
  }
}

/// Slanted stripes, worn.
PI_SIMULATION_VECTORISED void paintWarning(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  const Rgb accent(p.accent);
  float detail[LANES];
  fractalNoise(*s, {0.3f, 7, 0.8f, 1.0f, p.seed}, detail);
  for (int i = 0; i < s->n; ++i)
  {
    const float stripe = pulseTrain(s->u[i] + s->v[i], 0.36f, 0.18f, 0.7f * (s->wu[i] + s->wv[i]));
    paint(s, i, color, 1.0f + 0.3f * detail[i]);
    cover(s, i, accent, 1.0f + 0.6f * detail[i], stripe);
  }
}

/// Painted tube: rings of other colour at random heights, scratches.
PI_SIMULATION_VECTORISED void paintMetal(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  const Rgb accent(p.accent);
  float detail[LANES];
  fractalNoise(*s, {0.15f, 6, 0.8f, 3.0f, p.seed}, detail);
  for (int i = 0; i < s->n; ++i)
  {
    const float height = s->v[i] + 50.0f;
    const int band = floorInt(height / 0.45f);
    const float low = 0.45f * static_cast<float>(band);
    const float ring = pulse(height, low + 0.05f, low + 0.05f + 0.3f * cellRandom(band, 1, p.seed), s->wv[i]);
    paint(s, i, color, 1.0f + 0.4f * detail[i]);
    cover(s, i, accent, 1.0f + 0.4f * detail[i], cellRandom(band, 2, p.seed) < 0.5f ? ring : 0.0f);
  }
}

/// Stripes and folds.
PI_SIMULATION_VECTORISED void paintCloth(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  const Rgb accent(p.accent);
  const float stripes = (p.seed & 3u) == 0 ? 0.8f : 0.15f;
  float folds[LANES];
  fractalNoise(*s, {0.2f, 6, 0.75f, 1.5f, p.seed}, folds);
  for (int i = 0; i < s->n; ++i)
  {
    paint(s, i, color, 1.0f + 0.5f * folds[i]);
    cover(s, i, accent, 1.0f + 0.5f * folds[i], stripes * pulseTrain(s->v[i], 0.12f, 0.05f, s->wv[i]));
  }
}

/// Two light bands.
PI_SIMULATION_VECTORISED void paintCone(const Primitive& p, Surface* s)
{
  const Rgb accent(p.accent);
  paintRough(p, {0.08f, 4, 0.7f, 1.0f, p.seed}, 0.2f, s);
  for (int i = 0; i < s->n; ++i)
  {
    const float bands = pulse(s->v[i], -0.1f, 0.02f, s->wv[i]) + pulse(s->v[i], 0.1f, 0.19f, s->wv[i]);
    cover(s, i, accent, 1.0f, bands);
  }
}

/// Blocks with joints.
PI_SIMULATION_VECTORISED void paintStone(const Primitive& p, Surface* s)
{
  const Rgb color(p.color);
  paintRough(p, {0.1f, 6, 0.8f, 1.0f, p.seed}, 0.35f, s);
  for (int i = 0; i < s->n; ++i)
  {
    cover(s, i, color, 0.4f, pulseTrain(s->u[i] + 50.0f, 0.9f, 0.015f, s->wu[i]));
  }
}

void applyMaterial(const Scene& scene, const Primitive& p, Surface* s)
{
  switch (p.material)
  {
    case Material::STREET:
      return paintStreet(scene, s);
    case Material::FACADE:
      return paintFacade(p, s);
    case Material::BARK:
      return paintRough(p, {0.12f, 6, 0.8f, 5.0f, p.seed}, 1.0f, s);
    case Material::FOLIAGE:
      return paintFoliage(p, s);
    case Material::METAL:
      return paintMetal(p, s);
    case Material::SIGN:
      return paintSign(p, s);
    case Material::CAR_PAINT:
      return paintCar(p, s);
    case Material::GLASS:
      return paintGlass(p, s);
    case Material::RUBBER:
      return paintRough(p, {0.1f, 5, 0.8f, 1.0f, p.seed}, 0.6f, s);
    case Material::CLOTH:
      return paintCloth(p, s);
    case Material::SHIRT:
      return paintShirt(p, s);
    case Material::JACKET:
      return paintJacket(p, s);
    case Material::SLEEVE:
      return paintSleeve(p, s);
    case Material::TROUSERS:
      return paintTrousers(p, s);
    case Material::SKIRT:
      return paintSkirt(p, s);
    case Material::SHOE:
      return paintShoe(p, s);
    case Material::FACE:
      return paintFace(p, s);
    case Material::HAIR:
      return paintHair(p, s);
    case Material::TUBE:
      return paintRough(p, {0.1f, 3, 0.7f, 1.0f, p.seed}, 0.15f, s);
    case Material::CONE:
      return paintCone(p, s);
    case Material::STONE:
      return paintStone(p, s);
    case Material::SKIN:
      return paintRough(p, {0.06f, 4, 0.7f, 1.0f, p.seed}, 0.25f, s);
    case Material::HALL_SHELL:
      return paintHallShell(p, s);
    case Material::POSTER:
      return paintPoster(p, s);
    case Material::SHELF:
      return paintShelf(p, s);
    case Material::CRATE:
      return paintCrate(p, s);
    case Material::MACHINE:
      return paintMachine(p, s);
    case Material::PIPE:
      return paintPipe(p, s);
    case Material::WARNING:
      return paintWarning(p, s);
    case Material::LAMP:
      for (int i = 0; i < s->n; ++i)
      {
        s->light[i] = 1.0f;  // shines by itself
      }
      return paintRough(p, {0.3f, 4, 0.6f, 1.0f, p.seed}, 0.1f, s);
  }
}

}  // namespace pi_simulation::synthetic
