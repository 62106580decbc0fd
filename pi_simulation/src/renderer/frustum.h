#pragma once

#include "renderer/bounding_tree.h"

#include <Eigen/Core>
#include <array>

namespace pi_simulation::synthetic
{

/// Four planes around a bundle of rays from the origin of their frame: unnormalised normals, outwards.
using FrustumNormals = std::array<Eigen::Vector3f, 4>;

/// Pyramid around all rays of a packet: four planes through their common origin, in the world.
class Frustum
{
public:
  /// @param normals  in the frame that R turns into the world.
  Frustum(const FrustumNormals& normals, const Eigen::Matrix3f& R, const Eigen::Vector3f& origin) : origin_(origin)
  {
    for (size_t i = 0; i < normals.size(); ++i)
    {
      const Eigen::Vector3f n = R * normals[i];
      // Coordinates may be much larger than distances; the offset gives way by what their products are rounded.
      const float rounding = 4e-7f * n.cwiseProduct(origin_).lpNorm<1>();
      planes_[i] = {n.x(), n.y(), n.z(), n.dot(origin_) + rounding};
    }
  }

  /// True if the box is beside all rays.
  bool misses(const Bounds& bounds) const
  {
    for (const Plane& plane : planes_)
    {
      // Smallest value of normal * point over the box; above that of the origin, all of it is outside of this plane.
      const float x = plane.x * (plane.x > 0.0f ? bounds.low.x() : bounds.high.x());
      const float y = plane.y * (plane.y > 0.0f ? bounds.low.y() : bounds.high.y());
      const float z = plane.z * (plane.z > 0.0f ? bounds.low.z() : bounds.high.z());
      if (x + y + z > plane.offset)
      {
        return true;
      }
    }
    return false;
  }

  float squaredDistance(const Bounds& bounds) const
  {
    return (bounds.low - origin_).cwiseMax(origin_ - bounds.high).cwiseMax(0.0f).squaredNorm();
  }

private:
  struct Plane
  {
    float x;  ///< normal, outwards
    float y;
    float z;
    float offset;  ///< normal * origin
  };
  Eigen::Vector3f origin_;
  std::array<Plane, 4> planes_;
};

}  // namespace pi_simulation::synthetic
