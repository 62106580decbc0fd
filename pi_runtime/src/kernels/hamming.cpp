#include <pi_runtime/kernels/hamming.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

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

/// Candidates are the trains first, ..., first + count - 1.
PI_RUNTIME_SIMD_CLONES
void compareRun(const uint8_t* query, const uint8_t* trains, uint32_t first, uint32_t count, BestTwo* found)
{
  uint64_t q[4];
  std::memcpy(q, query, sizeof(q));
  BestTwo nearest = *found;
  for (uint32_t i = first; i < first + count; ++i)
  {
    uint64_t t[4];
    std::memcpy(t, trains + static_cast<size_t>(i) * HAMMING_BYTES, sizeof(t));
    const int distance = __builtin_popcountll(q[0] ^ t[0]) + __builtin_popcountll(q[1] ^ t[1]) +
                         __builtin_popcountll(q[2] ^ t[2]) + __builtin_popcountll(q[3] ^ t[3]);
    nearest.add(static_cast<uint32_t>(distance) << INDEX_BITS | i);
  }
  *found = nearest;
}

/// Which trains lie in the window of a query: 1 or 0 each.
PI_RUNTIME_SIMD_CLONES
void markWindow(float x, float y, const float* __restrict trains, int count, const HammingShape& shape,
                uint8_t* __restrict inside)
{
  const float max_rows = shape.max_rows;
  const float low = shape.min_disparity;
  const float high = shape.max_disparity;
  for (int i = 0; i < count; ++i)
  {
    const float disparity = x - trains[2 * i];
    const float rows = std::fabs(y - trains[2 * i + 1]);
    inside[i] = (rows <= max_rows) & (disparity >= low) & (disparity <= high) ? 1 : 0;
  }
}

void unpack(uint32_t key, int32_t* index, int32_t* distance)
{
  *index = key == NO_KEY ? HAMMING_NOBODY : static_cast<int32_t>(key & ((1U << INDEX_BITS) - 1));
  *distance = key == NO_KEY ? HAMMING_FAR : static_cast<int32_t>(key >> INDEX_BITS);
}

}  // namespace

void matchHamming(const uint8_t* queries, const uint8_t* trains, const float* query_positions,
                  const float* train_positions, const HammingShape& shape, size_t begin, size_t end,
                  HammingMatch* matches)
{
  const auto train_count = static_cast<uint32_t>(shape.trains);
  std::vector<uint8_t> inside(shape.use_window != 0 ? train_count + 1 : 0);
  for (size_t i = begin; i < end; ++i)
  {
    const uint8_t* const query = queries + i * HAMMING_BYTES;
    BestTwo found;
    if (shape.use_window == 0)
    {
      compareRun(query, trains, 0, train_count, &found);
    }
    else
    {
      markWindow(query_positions[2 * i], query_positions[2 * i + 1], train_positions, shape.trains, shape,
                 inside.data());
      const auto next = [&](const uint8_t* from)
      { return static_cast<const uint8_t*>(std::memchr(from, 1, inside.data() + train_count - from)); };
      for (const uint8_t* at = next(inside.data()); at != nullptr; at = next(at + 1))
      {
        compareRun(query, trains, static_cast<uint32_t>(at - inside.data()), 1, &found);
      }
    }
    unpack(found.best, &matches[i].best, &matches[i].best_distance);
    unpack(found.second, &matches[i].second, &matches[i].second_distance);
  }
}

}  // namespace pi_runtime::kernels
