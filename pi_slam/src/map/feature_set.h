#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

namespace pi_slam::map
{

constexpr size_t DESCRIPTOR_BYTES = 32;

/// Bits that differ between two descriptors.
inline int descriptorDistance(const uint8_t* a, const uint8_t* b)
{
  int distance = 0;
  for (size_t i = 0; i < DESCRIPTOR_BYTES; i += 8)
  {
    uint64_t x;
    uint64_t y;
    std::memcpy(&x, a + i, 8);
    std::memcpy(&y, b + i, 8);
    distance += __builtin_popcountll(x ^ y);
  }
  return distance;
}

/// A corner with its place in space: a ray from the left camera, in axes of the body, and how far along it.
struct MapFeature
{
  Eigen::Vector3f bearing = Eigen::Vector3f::UnitX();  ///< unit vector in the body's axes
  float inverse_distance = 0.0F;                       ///< from the left camera [1/m]
  float inverse_deviation = 0.0F;                      ///< of it [1/m], above 0
  uint8_t grey = 0;                                    ///< of the picture there
  uint8_t level = 0;                                   ///< of the pyramid in which it was found
};

/// What the map keeps of one pair of pictures. Immutable once made.
struct FeatureSet
{
  Eigen::Vector3f p_body_camera = Eigen::Vector3f::Zero();  ///< where the rays begin, in the body frame [m]
  std::vector<MapFeature> features;
  std::vector<uint8_t> descriptors;  ///< DESCRIPTOR_BYTES per feature

  size_t size() const { return features.size(); }
  const uint8_t* descriptor(size_t index) const { return descriptors.data() + index * DESCRIPTOR_BYTES; }
  size_t bytes() const { return sizeof(*this) + features.capacity() * sizeof(MapFeature) + descriptors.capacity(); }
};
using FeatureSetPtr = std::shared_ptr<const FeatureSet>;

}  // namespace pi_slam::map
