#pragma once

#include "renderer/bounding_tree.h"

#include <cstdint>
#include <vector>

namespace pi_simulation::synthetic
{

struct Primitive;

/// What keeps the sun from the ground. Built once, then read by any thread.
class Shadows
{
public:
  Shadows() = default;
  /// Of all primitives from `first` on. @param sun  unit vector to it.
  Shadows(const std::vector<Primitive>& primitives, size_t first, const Eigen::Vector3f& sun, float ground_z);

  /// Sets `light` of the points on the ground that lie in a shadow to `dark`.
  /// @param first  the same primitive. @param u, v  points in the world [m]. @param n  how many, a multiple of 8.
  void cast(const Primitive* first, const float* u, const float* v, int n, float dark, float* light) const;

private:
  Eigen::Vector3f sun_ = Eigen::Vector3f::UnitZ();
  float ground_z_ = 0.0f;
  BoundingTree tree_;  ///< of the shadows on the ground
};

}  // namespace pi_simulation::synthetic
