#pragma once

#include "renderer/scene.h"
#include "renderer/texture.h"

namespace pi_simulation::synthetic
{

/// Plain numbers: vector loops read them faster than Eigen's.
struct Rgb
{
  explicit Rgb(const Eigen::Vector3f& color) : r(color.x()), g(color.y()), b(color.z()) {}
  Rgb(float red, float green, float blue) : r(red), g(green), b(blue) {}
  float r;
  float g;
  float b;
};

/// Sets the colour of point i to `color` times `brightness`.
inline void paint(Surface* s, int i, const Rgb& color, float brightness)
{
  s->r[i] = color.r * brightness;
  s->g[i] = color.g * brightness;
  s->b[i] = color.b * brightness;
}

/// Covers point i with `color` times `brightness` to the part `weight`.
inline void cover(Surface* s, int i, const Rgb& color, float brightness, float weight)
{
  s->r[i] = mix(s->r[i], color.r * brightness, weight);
  s->g[i] = mix(s->g[i], color.g * brightness, weight);
  s->b[i] = mix(s->b[i], color.b * brightness, weight);
}

inline float widest(const Surface& s, int i)
{
  return std::max(s.wu[i], s.wv[i]);
}

// Outdoors, in materials_outdoor.cpp.
void paintStreet(const Scene& scene, Surface* s);
void paintFacade(const Primitive& p, Surface* s);
void paintCar(const Primitive& p, Surface* s);
void paintGlass(const Primitive& p, Surface* s);
void paintFoliage(const Primitive& p, Surface* s);

// People, in materials_people.cpp.
void paintShirt(const Primitive& p, Surface* s);
void paintJacket(const Primitive& p, Surface* s);
void paintSleeve(const Primitive& p, Surface* s);
void paintTrousers(const Primitive& p, Surface* s);
void paintSkirt(const Primitive& p, Surface* s);
void paintShoe(const Primitive& p, Surface* s);
void paintFace(const Primitive& p, Surface* s);
void paintHair(const Primitive& p, Surface* s);

// Indoors, in materials_indoor.cpp.
void paintHallShell(const Primitive& p, Surface* s);
void paintShelf(const Primitive& p, Surface* s);
void paintCrate(const Primitive& p, Surface* s);
void paintMachine(const Primitive& p, Surface* s);
void paintPipe(const Primitive& p, Surface* s);

// Anywhere, in materials.cpp.
void paintRough(const Primitive& p, const NoiseSpec& noise, float contrast, Surface* s);
void paintSign(const Primitive& p, Surface* s);
void paintPoster(const Primitive& p, Surface* s);
void paintWarning(const Primitive& p, Surface* s);
void paintMetal(const Primitive& p, Surface* s);
void paintCloth(const Primitive& p, Surface* s);
void paintCone(const Primitive& p, Surface* s);
void paintStone(const Primitive& p, Surface* s);

}  // namespace pi_simulation::synthetic
