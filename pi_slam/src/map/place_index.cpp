#include "map/place_index.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pi_slam::map
{

namespace
{

constexpr size_t KEYS = 1U << 16;
constexpr size_t PROBES = 17;  ///< the key itself, and with one bit turned over
constexpr uint32_t INDEX_BITS = 12;
constexpr uint32_t INDEX_MASK = (1U << INDEX_BITS) - 1;
constexpr size_t MOST_IN_BUCKET = 200;  ///< longer lists tell nothing about the place, and cost the time of the rest
/// Descriptors of different things differ in 128 of 256 bits, with a deviation of 8: this is nine of them below. Of a
/// signature's 32 bits it is the same part.
constexpr int SAME_WORD_BITS = 56;
constexpr int MAX_SIGNATURE_DISTANCE = 7;

/// Table t looks at bytes 2 t and 2 t + 1.
uint32_t keyOf(const uint8_t* descriptor, size_t table)
{
  uint16_t key;
  std::memcpy(&key, descriptor + 2 * table, sizeof(key));
  return key;
}

/// Bytes that no table looks at; others for each of them.
uint32_t signatureOf(const uint8_t* descriptor, size_t table)
{
  uint32_t signature;
  std::memcpy(&signature, descriptor + 8 + 4 * table, sizeof(signature));
  return signature;
}

}  // namespace

PlaceIndex::PlaceIndex()
{
  clear();
}

void PlaceIndex::clear()
{
  for (std::vector<Bucket>& table : tables_)
  {
    table.assign(KEYS, Bucket());
  }
  keyframes_.clear();
  by_number_.clear();
  bytes_ = TABLES * KEYS * sizeof(Bucket);
}

void PlaceIndex::add(uint32_t keyframe, FeatureSetPtr features)
{
  const size_t count = std::min<size_t>(features->size(), INDEX_MASK + 1);
  for (size_t i = 0; i < count; ++i)
  {
    const uint8_t* const descriptor = features->descriptor(i);
    for (size_t t = 0; t < TABLES; ++t)
    {
      Bucket& bucket = tables_[t][keyOf(descriptor, t)];
      if (bucket.size() == bucket.capacity())
      {
        const size_t before = bucket.capacity();
        bucket.reserve(bucket.size() + std::max<size_t>(2, bucket.size() / 4));
        bytes_ += (bucket.capacity() - before) * sizeof(Entry);
      }
      bucket.push_back({keyframe << INDEX_BITS | static_cast<uint32_t>(i), signatureOf(descriptor, t)});
    }
  }
  by_number_.resize(std::max<size_t>(by_number_.size(), keyframe + 1), nullptr);
  by_number_[keyframe] = features.get();
  keyframes_[keyframe] = std::move(features);
}

void PlaceIndex::remove(uint32_t keyframe)
{
  const auto found = keyframes_.find(keyframe);
  if (found == keyframes_.end())
  {
    return;
  }
  const FeatureSet& features = *found->second;
  const size_t count = std::min<size_t>(features.size(), INDEX_MASK + 1);
  for (size_t i = 0; i < count; ++i)
  {
    for (size_t t = 0; t < TABLES; ++t)
    {
      Bucket& bucket = tables_[t][keyOf(features.descriptor(i), t)];
      bucket.erase(std::remove_if(bucket.begin(), bucket.end(),
                                  [&](const Entry& entry) { return entry.feature >> INDEX_BITS == keyframe; }),
                   bucket.end());
    }
  }
  by_number_[keyframe] = nullptr;
  keyframes_.erase(found);
}

std::vector<PlaceIndex::Vote> PlaceIndex::query(const FeatureSet& features) const
{
  std::vector<float> weights(by_number_.size(), 0.0F);
  std::vector<uint32_t> seen(by_number_.size(), 0);  // 1 + the feature that voted last
  std::vector<uint32_t> fits;
  for (size_t i = 0; i < features.size(); ++i)
  {
    const uint8_t* const descriptor = features.descriptor(i);
    fits.clear();
    // Each list lies elsewhere in memory: prefetching all hides the latency.
    const Bucket* buckets[TABLES * PROBES];
    for (size_t t = 0; t < TABLES; ++t)
    {
      const uint32_t key = keyOf(descriptor, t);
      for (size_t flip = 0; flip < PROBES; ++flip)
      {
        buckets[t * PROBES + flip] = &tables_[t][flip < 16 ? key ^ (1U << flip) : key];
        __builtin_prefetch(buckets[t * PROBES + flip]);
      }
    }
    for (const Bucket* bucket : buckets)
    {
      __builtin_prefetch(bucket->data());
    }
    for (size_t k = 0; k < TABLES * PROBES; ++k)
    {
      const uint32_t signature = signatureOf(descriptor, k / PROBES);
      if (buckets[k]->size() > MOST_IN_BUCKET)
      {
        continue;
      }
      for (const Entry& entry : *buckets[k])
      {
        if (__builtin_popcount(entry.signature ^ signature) > MAX_SIGNATURE_DISTANCE)
        {
          continue;
        }
        const uint32_t keyframe = entry.feature >> INDEX_BITS;
        if (seen[keyframe] != i + 1 &&
            descriptorDistance(descriptor, by_number_[keyframe]->descriptor(entry.feature & INDEX_MASK)) <=
                SAME_WORD_BITS)
        {
          seen[keyframe] = static_cast<uint32_t>(i) + 1;
          fits.push_back(keyframe);
        }
      }
    }
    const float weight = fits.empty() ? 0.0F : 1.0F / std::sqrt(static_cast<float>(fits.size()));
    for (const uint32_t keyframe : fits)
    {
      weights[keyframe] += weight;
    }
  }
  std::vector<Vote> votes;
  for (size_t k = 0; k < weights.size(); ++k)
  {
    if (weights[k] > 0.0F)
    {
      votes.push_back({static_cast<uint32_t>(k), weights[k]});
    }
  }
  std::sort(votes.begin(), votes.end(),
            [](const Vote& a, const Vote& b)
            { return a.weight != b.weight ? a.weight > b.weight : a.keyframe < b.keyframe; });
  return votes;
}

}  // namespace pi_slam::map
