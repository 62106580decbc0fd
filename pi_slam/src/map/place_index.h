#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "map/feature_set.h"

namespace pi_slam::map
{

/// Finds keyframes that look like a picture, by their binary descriptors, without a vocabulary learned before:
/// multi-index hashing (Norouzi, Punjani and Fleet, CVPR 2012). A table per 16 bits of the descriptor lists who has
/// these bits; near descriptors agree in one of the tables up to one bit. Grows and shrinks keyframe by keyframe.
/// Not thread safe. Deterministic.
class PlaceIndex
{
public:
  struct Vote
  {
    uint32_t keyframe = 0;
    float weight = 0.0F;
  };

  PlaceIndex();

  /// @param keyframe  not in the index yet, below 2^20. At most 2^12 features are taken.
  void add(uint32_t keyframe, FeatureSetPtr features);
  void remove(uint32_t keyframe);
  void clear();

  /// Keyframes that share features with `features`, best first. Each feature has one vote, which it splits among the
  /// places that it fits. So features that are seen everywhere count little.
  std::vector<Vote> query(const FeatureSet& features) const;

  size_t bytes() const { return bytes_; }

private:
  static constexpr size_t TABLES = 4;
  struct Entry
  {
    uint32_t feature;    ///< keyframe << 12 | index
    uint32_t signature;  ///< 32 other bits of the descriptor
  };
  using Bucket = std::vector<Entry>;

  std::array<std::vector<Bucket>, TABLES> tables_;
  std::unordered_map<uint32_t, FeatureSetPtr> keyframes_;
  std::vector<const FeatureSet*> by_number_;  ///< null: not there
  size_t bytes_ = 0;
};

}  // namespace pi_slam::map
