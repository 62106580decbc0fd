// Brute-force matching of 256-bit descriptors: pi_runtime/kernels/hamming.h has the contract. Needs prelude.cl in
// front. One work item per query. A key is distance << INDEX_BITS | index, so that its order is that of the matches.

#define INDEX_BITS 22
#define NO_KEY 0xFFFFFFFFu

typedef struct
{
  int best;
  int second;
  int best_distance;
  int second_distance;
} HammingMatch;

typedef struct
{
  int queries;
  int trains;
  int use_window;
  float max_rows;
  float min_disparity;
  float max_disparity;
} HammingShape;

// PoCL 3.1 makes popcount() of shifts and masks; the compiler's own becomes the processor's instruction.
#ifdef __clang__
#define COUNT_BITS(bits) (uint)__builtin_popcountl(bits)
#else
#define COUNT_BITS(bits) (uint)popcount(bits)
#endif

INLINE uint distanceOf(ulong4 query, ulong4 train)
{
  const ulong4 bits = query ^ train;
  return COUNT_BITS(bits.s0) + COUNT_BITS(bits.s1) + COUNT_BITS(bits.s2) + COUNT_BITS(bits.s3);
}

INLINE HammingMatch matchOf(uint best, uint second)
{
  const uint mask = (1u << INDEX_BITS) - 1;
  HammingMatch match;
  match.best = best == NO_KEY ? -1 : (int)(best & mask);
  match.second = second == NO_KEY ? -1 : (int)(second & mask);
  match.best_distance = best == NO_KEY ? 257 : (int)(best >> INDEX_BITS);
  match.second_distance = second == NO_KEY ? 257 : (int)(second >> INDEX_BITS);
  return match;
}

kernel void match_all(global const ulong* queries, global const ulong* trains, global HammingMatch* matches,
                      const HammingShape shape, const int begin, const int end)
{
  const int i = begin + (int)get_global_id(0);
  if (i >= end)
  {
    return;
  }
  const ulong4 query = vload4(i, queries);
  uint best = NO_KEY;
  uint second = NO_KEY;
  for (int t = 0; t < shape.trains; ++t)
  {
    const uint key = distanceOf(query, vload4(t, trains)) << INDEX_BITS | (uint)t;
    second = min(second, max(best, key));
    best = min(best, key);
  }
  matches[i] = matchOf(best, second);
}

// Whether one of eight trains lies in the window. (PoCL's any() tests the elements one by one.)
INLINE bool anyInWindow(float2 position, float16 trains, const HammingShape* shape)
{
  const float8 disparity = position.x - trains.even;
  const float8 rows = fabs(position.y - trains.odd);
  const int8 inside =
      (rows <= shape->max_rows) & (disparity >= shape->min_disparity) & (disparity <= shape->max_disparity);
  const int4 half_way = inside.lo | inside.hi;
  const int2 last = half_way.lo | half_way.hi;
  return (last.x | last.y) != 0;
}

kernel void match_in_window(global const ulong* queries, global const ulong* trains,
                            global const float2* query_positions, global const float2* train_positions,
                            global HammingMatch* matches, const HammingShape shape, const int begin, const int end)
{
  const int i = begin + (int)get_global_id(0);
  if (i >= end)
  {
    return;
  }
  const ulong4 query = vload4(i, queries);
  const float2 position = query_positions[i];
  uint best = NO_KEY;
  uint second = NO_KEY;
  for (int first = 0; first < shape.trains; first += 8)
  {
    // Few trains lie in the window, so that mostly all eight of a block are passed over at once.
    const int count = min(8, shape.trains - first);
    if (count == 8 && !anyInWindow(position, vload16(0, (global const float*)(train_positions + first)), &shape))
    {
      continue;
    }
    for (int k = 0; k < count; ++k)
    {
      const int t = first + k;
      const float2 difference = position - train_positions[t];
      if (fabs(difference.y) <= shape.max_rows && difference.x >= shape.min_disparity &&
          difference.x <= shape.max_disparity)
      {
        const uint key = distanceOf(query, vload4(t, trains)) << INDEX_BITS | (uint)t;
        second = min(second, max(best, key));
        best = min(best, key);
      }
    }
  }
  matches[i] = matchOf(best, second);
}
