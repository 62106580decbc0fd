// FAST-9 corners: see pi_runtime/kernels/fast_corners.h. Needs prelude.cl in front.
//
// Working memory: a map of scores with a margin of zeros, MAP_LEFT columns left of the first pixel that can be a corner
// (column and row RADIUS of the image), one row above, and at least one column and row on the other sides; behind it a
// mask of maxima for each BLOCK columns of each row; behind them where each row's corners begin in the list.

#define RADIUS 3
#define MAP_LEFT 16
#define BLOCK 32

typedef struct
{
  ushort x;
  ushort y;
  int score;
} Corner;

// As many pixels as CPUs compare at once, where the compiler has such vectors.
#ifdef __clang__
#define WIDTH 32
typedef uchar Pixels __attribute__((ext_vector_type(WIDTH)));
typedef Pixels anywhere_pixels __attribute__((aligned(1)));
#define LOAD(from) (*(global const anywhere_pixels*)(from))
#define STORE(to, pixels) (*(global anywhere_pixels*)(to) = (pixels))
INLINE bool anyNonZero(Pixels p)
{
  const ulong4 parts = __builtin_astype(p, ulong4);
  return (parts.x | parts.y | parts.z | parts.w) != 0;
}
#else
#define WIDTH 16
typedef uchar16 Pixels;
#define LOAD LOAD16
#define STORE STORE16
INLINE bool anyNonZero(Pixels p)
{
  const ulong2 parts = as_ulong2(p);
  return (parts.x | parts.y) != 0;
}
#endif

INLINE Pixels lower(Pixels a, Pixels b)
{
  return a < b ? a : b;
}

INLINE Pixels higher(Pixels a, Pixels b)
{
  return a > b ? a : b;
}

// The larger of: how far bright is above v, how far dark is below it; 0 if neither.
INLINE Pixels contrast(Pixels v, Pixels bright, Pixels dark)
{
  return higher(higher(bright, v) - v, v - lower(dark, v));
}

// Scores of WIDTH pixels; the native twin explains them.
INLINE Pixels scoresAt(global const uchar* pixel, int stride, uchar threshold)
{
  const Pixels v = LOAD(pixel);
  const Pixels c0 = LOAD(pixel - 3 * stride);
  const Pixels c4 = LOAD(pixel + 3);
  const Pixels c8 = LOAD(pixel + 3 * stride);
  const Pixels c12 = LOAD(pixel - 3);
  const Pixels bound = contrast(v, lower(higher(c0, c8), higher(c4, c12)), higher(lower(c0, c8), lower(c4, c12)));
  if (!anyNonZero(higher(bound, (Pixels)threshold) - (Pixels)threshold))
  {
    return (Pixels)0;
  }
  const Pixels c1 = LOAD(pixel - 3 * stride + 1);
  const Pixels c2 = LOAD(pixel - 2 * stride + 2);
  const Pixels c3 = LOAD(pixel - stride + 3);
  const Pixels c5 = LOAD(pixel + stride + 3);
  const Pixels c6 = LOAD(pixel + 2 * stride + 2);
  const Pixels c7 = LOAD(pixel + 3 * stride + 1);
  const Pixels c9 = LOAD(pixel + 3 * stride - 1);
  const Pixels c10 = LOAD(pixel + 2 * stride - 2);
  const Pixels c11 = LOAD(pixel + stride - 3);
  const Pixels c13 = LOAD(pixel - stride - 3);
  const Pixels c14 = LOAD(pixel - 2 * stride - 2);
  const Pixels c15 = LOAD(pixel - 3 * stride - 1);
// The arcs of 9 pixels in a row, two at a time. PICK1 and PICK2: lower and higher for bright arcs.
#define ARCS(PICK1, PICK2, result)                                                                   \
  {                                                                                                  \
    const Pixels p1 = PICK1(c1, c2), p3 = PICK1(c3, c4), p5 = PICK1(c5, c6), p7 = PICK1(c7, c8);    \
    const Pixels p9 = PICK1(c9, c10), p11 = PICK1(c11, c12), p13 = PICK1(c13, c14), p15 = PICK1(c15, c0); \
    const Pixels q1 = PICK1(p1, p3), q3 = PICK1(p3, p5), q5 = PICK1(p5, p7), q7 = PICK1(p7, p9);    \
    const Pixels q9 = PICK1(p9, p11), q11 = PICK1(p11, p13), q13 = PICK1(p13, p15), q15 = PICK1(p15, p1); \
    result = PICK1(PICK1(q1, q5), PICK2(c0, c9));                                                    \
    result = PICK2(result, PICK1(PICK1(q3, q7), PICK2(c2, c11)));                                    \
    result = PICK2(result, PICK1(PICK1(q5, q9), PICK2(c4, c13)));                                    \
    result = PICK2(result, PICK1(PICK1(q7, q11), PICK2(c6, c15)));                                   \
    result = PICK2(result, PICK1(PICK1(q9, q13), PICK2(c8, c1)));                                    \
    result = PICK2(result, PICK1(PICK1(q11, q15), PICK2(c10, c3)));                                  \
    result = PICK2(result, PICK1(PICK1(q13, q1), PICK2(c12, c5)));                                   \
    result = PICK2(result, PICK1(PICK1(q15, q3), PICK2(c14, c7)));                                   \
  }
  Pixels bright;
  Pixels dark;
  ARCS(lower, higher, bright)
  ARCS(higher, lower, dark)
  const Pixels found = contrast(v, bright, dark);
  return found > threshold ? found - (Pixels)1 : (Pixels)0;
}

// BLOCK pixels of the map per item. width and height are those of the map without margins, at least 32 x 1; the map has
// two rows more. A vector that would reach over the last column starts earlier: it stores what its neighbour
// stores, too.
kernel void fast_score(global const uchar* restrict image, int stride, int width, int height, int threshold,
                       global uchar* restrict map, int map_stride)
{
  const int begin = (int)get_global_id(0) * BLOCK;
  const int y = (int)get_global_id(1) - 1;
  if (begin >= map_stride - MAP_LEFT || y > height)
  {
    return;
  }
  global uchar* scores = map + (size_t)(y + 1) * map_stride + MAP_LEFT;
  if (begin == 0)
  {
    STORE16(scores - MAP_LEFT, (uchar16)0);
  }
  const bool inside = y >= 0 && y < height;
  global const uchar* pixels = image + (size_t)(max(y, 0) + RADIUS) * stride + RADIUS;
  for (int x = begin; x < begin + BLOCK; x += WIDTH)
  {
    if (x + WIDTH > width || !inside)
    {
      STORE(scores + x, (Pixels)0);
    }
    if (x < width && inside)
    {
      const int first = min(x, width - WIDTH);
      STORE(scores + first, scoresAt(pixels + first, stride, (uchar)threshold));
    }
  }
}

// The mask of the maxima of BLOCK pixels per item.
kernel void fast_maxima(global uchar* map, int map_stride, int blocks, int height, ulong masks_at)
{
  const int block = get_global_id(0);
  const size_t y = get_global_id(1);
  if (block >= blocks || y >= height)
  {
    return;
  }
  uint mask = 0;
  for (int part = 0; part < BLOCK; part += 16)
  {
    global const uchar* at = map + (y + 1) * map_stride + MAP_LEFT + block * BLOCK + part;
    const uchar16 score = LOAD16(at);
    const ulong2 some = as_ulong2(score);
    if ((some.x | some.y) == 0)
    {
      continue;
    }
    uchar16 around = max(LOAD16(at - 1), LOAD16(at + 1));
    around = max(around, max(LOAD16(at - map_stride - 1), LOAD16(at + map_stride - 1)));
    around = max(around, max(LOAD16(at - map_stride), LOAD16(at + map_stride)));
    around = max(around, max(LOAD16(at - map_stride + 1), LOAD16(at + map_stride + 1)));
    // One bit per pixel: byte i of the weights is 1 << (i % 8), and the bytes of a half add up without carry.
    const uchar16 weights = (uchar16)(1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128);
    const uchar16 bits = as_uchar16(score > around) & weights;
    const ulong2 sums = as_ulong2(bits) * 0x0101010101010101UL;
    mask |= ((uint)(sums.x >> 56) | (uint)(sums.y >> 56) << 8) << part;
  }
  ((global uint*)(map + masks_at))[y * blocks + block] = mask;
}

// Where each row's corners begin in the list, and their number: one group of ROW_ITEMS items, each with its own rows.
kernel void fast_offsets(global uchar* map, int blocks, int height, ulong masks_at, ulong offsets_at,
                         global uint* restrict count)
{
  global const uint* masks = (global const uint*)(map + masks_at);
  global uint* offsets = (global uint*)(map + offsets_at);
  local uint sums[ROW_ITEMS];
  const int item = get_local_id(0);
  const int rows = (height + ROW_ITEMS - 1) / ROW_ITEMS;
  const int begin = min(item * rows, height);
  const int end = min(begin + rows, height);
  uint sum = 0;
  for (int y = begin; y < end; ++y)
  {
    offsets[y] = sum;
    for (int block = 0; block < blocks; ++block)
    {
      sum += popcount(masks[(size_t)y * blocks + block]);
    }
  }
  sums[item] = sum;
  barrier(CLK_LOCAL_MEM_FENCE);
  uint before = 0;
  for (int i = 0; i < item; ++i)
  {
    before += sums[i];
  }
  for (int y = begin; y < end; ++y)
  {
    offsets[y] += before;
  }
  if (item == ROW_ITEMS - 1)
  {
    *count = before + sum;
  }
}

// The corners of one row per item.
kernel void fast_list(global const uchar* map, int map_stride, int blocks, int height, ulong masks_at, ulong offsets_at,
                      global Corner* restrict corners, int capacity)
{
  const int y = get_global_id(0);
  if (y >= height)
  {
    return;
  }
  global const uchar* scores = map + (size_t)(y + 1) * map_stride + MAP_LEFT;
  global const uint* masks = (global const uint*)(map + masks_at);
  uint place = ((global const uint*)(map + offsets_at))[y];
  for (int block = 0; block < blocks; ++block)
  {
    uint mask = masks[(size_t)y * blocks + block];
    while (mask != 0 && place < (uint)capacity)
    {
      const uint lowest = mask & -mask;
      const int x = block * BLOCK + popcount(lowest - 1);
      corners[place].x = (ushort)(x + RADIUS);
      corners[place].y = (ushort)(y + RADIUS);
      corners[place].score = scores[x];
      mask ^= lowest;
      ++place;
    }
  }
}

// Maps less than 32 wide: one item finds all scores of a row, pixel by pixel.
kernel void fast_score_narrow(global const uchar* restrict image, int stride, int width, int height, int threshold,
                              global uchar* restrict map, int map_stride)
{
  const int y = (int)get_global_id(1) - 1;
  global uchar* scores = map + (size_t)(y + 1) * map_stride;
  for (int x = 0; x < map_stride; ++x)
  {
    scores[x] = 0;
  }
  if (y < 0 || y >= height)
  {
    return;
  }
  const int dx[16] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
  const int dy[16] = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};
  for (int x = 0; x < width; ++x)
  {
    global const uchar* pixel = image + (size_t)(y + RADIUS) * stride + RADIUS + x;
    int found = 0;
    for (int first = 0; first < 16; ++first)
    {
      int low = 255;
      int high = 0;
      for (int k = first; k < first + 9; ++k)
      {
        const int c = pixel[dy[k % 16] * stride + dx[k % 16]];
        low = min(low, c);
        high = max(high, c);
      }
      found = max(found, max(low - *pixel, *pixel - high));
    }
    scores[MAP_LEFT + x] = found > threshold ? (uchar)(found - 1) : (uchar)0;
  }
}

// Images without any pixel that can be a corner.
kernel void fast_none(global uint* count)
{
  *count = 0;
}
