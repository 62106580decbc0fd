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
