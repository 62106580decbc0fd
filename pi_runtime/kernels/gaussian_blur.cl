// Gaussian blur of 7 x 7 px: pi_runtime/kernels/gaussian_blur.h has the contract. Needs prelude.cl in front.
// One work item makes RUN columns of ROWS rows: sums along a row are kept for the seven rows that need them.
// Global size: runs (padded to whole groups) by blocks of ROWS rows from `begin` on.

#define RUN 16
#define ROWS 32
#define RADIUS 3

typedef struct
{
  int width;
  int height;
  int source_stride;
  int stride;
} BlurGeometry;

#define WEIGHTED(a, b, c, d, e, f, g) \
  (((a) + (g)) * (ushort)18 + ((b) + (f)) * (ushort)34 + ((c) + (e)) * (ushort)48 + (d) * (ushort)56)
#define WIDE(from) convert_ushort16(LOAD16(from))

// Sums along row y, at RUN columns from x on.
INLINE ushort16 sumRow(global const uchar* source, const BlurGeometry* g, int x, int y)
{
  global const uchar* row = source + (size_t)reflect101(y, g->height) * g->source_stride;
  if (x >= RADIUS && x + RUN + RADIUS <= g->width)
  {
    global const uchar* p = row + x;
    return WEIGHTED(WIDE(p - 3), WIDE(p - 2), WIDE(p - 1), WIDE(p), WIDE(p + 1), WIDE(p + 2), WIDE(p + 3));
  }
  ushort window[RUN + 2 * RADIUS];
  for (int i = 0; i < RUN + 2 * RADIUS; ++i)
  {
    window[i] = row[reflect101(x + i - RADIUS, g->width)];
  }
  ushort sums[RUN];
  for (int i = 0; i < RUN; ++i)
  {
    const ushort* w = window + i;
    sums[i] = WEIGHTED(w[0], w[1], w[2], w[3], w[4], w[5], w[6]);
  }
  return vload16(0, sums);
}

// Sums of seven such rows to pixels. In bytes, so that 16 bits are enough; see sumRow() of gaussian_blur.cpp.
INLINE uchar16 sumColumns(ushort16 a, ushort16 b, ushort16 c, ushort16 d, ushort16 e, ushort16 f, ushort16 h)
{
  const ushort s = 8;
  const ushort m = 255;
  const ushort16 upper = WEIGHTED(a >> s, b >> s, c >> s, d >> s, e >> s, f >> s, h >> s);
  const ushort16 lower = WEIGHTED(a & m, b & m, c & m, d & m, e & m, f & m, h & m);
  return convert_uchar16((upper + (ushort)128 + (lower >> s)) >> s);
}

kernel void gaussian_blur7(global const uchar* source, global uchar* destination, const BlurGeometry g,
                           const int begin, const int end)
{
  const int x = (int)get_global_id(0) * RUN;
  const int first = begin + (int)get_global_id(1) * ROWS;
  const int last = min(first + ROWS, end);
  if (x >= g.width)
  {
    return;
  }
  const int columns = min(RUN, g.width - x);
  ushort16 a = 0;
  ushort16 b = 0;
  ushort16 c = 0;
  ushort16 d = 0;
  ushort16 e = 0;
  ushort16 f = 0;
  for (int y = first - 2 * RADIUS; y < last; ++y)
  {
    const ushort16 h = sumRow(source, &g, x, y + RADIUS);
    if (y >= first)
    {
      const uchar16 pixels = sumColumns(a, b, c, d, e, f, h);
      global uchar* out = destination + (size_t)y * g.stride + x;
      if (columns == RUN)
      {
        STORE16(out, pixels);
      }
      else
      {
        uchar rest[RUN];
        vstore16(pixels, 0, rest);
        for (int i = 0; i < columns; ++i)
        {
          out[i] = rest[i];
        }
      }
    }
    a = b;
    b = c;
    c = d;
    d = e;
    e = f;
    f = h;
  }
}
