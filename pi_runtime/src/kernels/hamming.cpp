#include <pi_runtime/kernels/hamming.h>

#include <algorithm>
#include <cstring>

#include "kernels/simd.h"

namespace pi_runtime::kernels
{
namespace
{

/// Distance and index in one number, whose order is that of the matches.
constexpr int INDEX_BITS = 22;
constexpr uint32_t NO_KEY = ~0U;

struct BestTwo
{
  uint32_t best = NO_KEY;
  uint32_t second = NO_KEY;

  void add(uint32_t key)
  {
    second = std::min(second, std::max(best, key));
    best = std::min(best, key);
  }
};

PI_RUNTIME_SIMD_CLONES
BestTwo compare(const uint8_t* query, const uint8_t* trains, uint32_t count)
{
  uint64_t q[4];
  std::memcpy(q, query, sizeof(q));
  BestTwo nearest;
  for (uint32_t i = 0; i < count; ++i)
  {
    uint64_t t[4];
    std::memcpy(t, trains + static_cast<size_t>(i) * HAMMING_BYTES, sizeof(t));
    const int distance = __builtin_popcountll(q[0] ^ t[0]) + __builtin_popcountll(q[1] ^ t[1]) +
                         __builtin_popcountll(q[2] ^ t[2]) + __builtin_popcountll(q[3] ^ t[3]);
    nearest.add(static_cast<uint32_t>(distance) << INDEX_BITS | i);
  }
  return nearest;
}

void unpack(uint32_t key, int32_t* index, int32_t* distance)
{
  *index = key == NO_KEY ? HAMMING_NOBODY : static_cast<int32_t>(key & ((1U << INDEX_BITS) - 1));
  *distance = key == NO_KEY ? HAMMING_FAR : static_cast<int32_t>(key >> INDEX_BITS);
}

}  // namespace

void matchHamming(const uint8_t* queries, const uint8_t* trains, const HammingShape& shape, size_t begin, size_t end,
                  HammingMatch* matches)
{
  for (size_t i = begin; i < end; ++i)
  {
    const BestTwo found = compare(queries + i * HAMMING_BYTES, trains, static_cast<uint32_t>(shape.trains));
    unpack(found.best, &matches[i].best, &matches[i].best_distance);
    unpack(found.second, &matches[i].second, &matches[i].second_distance);
  }
}

}  // namespace pi_runtime::kernels
