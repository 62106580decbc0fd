// Bilinear image warp by a fixed-point table: pi_runtime/kernels/rectify.h has the contract and the arithmetic.
// Needs prelude.cl in front.
// One work item makes RUN pixels of one row. Global size: runs (padded to whole groups) by rows.

#define RUN 16

typedef struct
{
  int source_width;
  int source_height;
  int source_stride;
  int channels;
  int width;
  int height;
  int stride;
} RemapGeometry;

INLINE int pixelOrZero(global const uchar* source, const RemapGeometry* g, int channels, int channel, int x, int y)
{
  const bool inside = x >= 0 && y >= 0 && x < g->source_width && y < g->source_height;
  return inside ? source[y * g->source_stride + x * channels + channel] : 0;
}

// Pixels whose neighbours may lie outside the source.
void guardedRun(global const uchar* source, const RemapGeometry* g, int channels, global const short* xy,
                global const ushort* fraction, int count, global uchar* out)
{
  for (int i = 0; i < count; ++i)
  {
    const int x = xy[2 * i];
    const int y = xy[2 * i + 1];
    const int ax = fraction[i] & 31;
    const int ay = fraction[i] >> 5 & 31;
    for (int c = 0; c < channels; ++c)
    {
      const int top = pixelOrZero(source, g, channels, c, x, y) * (32 - ax) +
                      pixelOrZero(source, g, channels, c, x + 1, y) * ax;
      const int bottom = pixelOrZero(source, g, channels, c, x, y + 1) * (32 - ax) +
                         pixelOrZero(source, g, channels, c, x + 1, y + 1) * ax;
      out[i * channels + c] = (uchar)((top * (32 - ay) + bottom * ay + 512) >> 10);
    }
  }
}

// Whether a run may read `reach` columns from x on, and the row below y: no sign bit in x, y, nor in the space left.
// (PoCL's any() tests the elements one by one.)
INLINE bool runInside(const RemapGeometry* g, int reach, int16 x, int16 y)
{
  const int16 signs = x | y | (g->source_width - reach - x) | (g->source_height - 2 - y);
  const int8 half_way = signs.lo | signs.hi;
  const int4 quarter = half_way.lo | half_way.hi;
  const int2 last = quarter.lo | quarter.hi;
  return (last.x | last.y) >= 0;
}

kernel void remap_1(global const uchar* source, global const short* xy_table, global const ushort* fraction_table,
                    global uchar* destination, const RemapGeometry g)
{
  const int x0 = (int)get_global_id(0) * RUN;
  const int row = (int)get_global_id(1);
  if (x0 >= g.width)
  {
    return;
  }
  global const short* xy = xy_table + 2 * ((size_t)row * g.width + x0);
  global const ushort* fraction = fraction_table + (size_t)row * g.width + x0;
  global uchar* out = destination + (size_t)row * g.stride + x0;
  if (x0 + RUN > g.width)
  {
    guardedRun(source, &g, 1, xy, fraction, g.width - x0, out);
    return;
  }
  const int16 point = vload16(0, (global const int*)xy);  // x in the low half, y in the high one
  const int16 x = point << 16 >> 16;
  const int16 y = point >> 16;
  if (!runInside(&g, 2, x, y))
  {
    guardedRun(source, &g, 1, xy, fraction, RUN, out);
    return;
  }
  int offset[RUN];
  ushort top[RUN];
  ushort bottom[RUN];
  vstore16(y * g.source_stride + x, 0, offset);
#pragma unroll
  for (int i = 0; i < RUN; ++i)
  {
    top[i] = as_ushort(vload2(0, source + offset[i]));
    bottom[i] = as_ushort(vload2(0, source + offset[i] + g.source_stride));
  }
  const ushort16 weights = vload16(0, fraction);
  const ushort16 ax = weights & (ushort)31;
  const ushort16 ay = weights >> (ushort)5;
  const ushort16 t = vload16(0, top);
  const ushort16 b = vload16(0, bottom);
  const ushort16 upper = (t & (ushort)255) * ((ushort)32 - ax) + (t >> (ushort)8) * ax;
  const ushort16 lower = (b & (ushort)255) * ((ushort)32 - ax) + (b >> (ushort)8) * ax;
  const uint16 sum =
      convert_uint16(upper) * convert_uint16((ushort)32 - ay) + convert_uint16(lower) * convert_uint16(ay);
  STORE16(out, convert_uchar16((sum + 512u) >> 10u));
}

kernel void remap_3(global const uchar* source, global const short* xy_table, global const ushort* fraction_table,
                    global uchar* destination, const RemapGeometry g)
{
  const int x0 = (int)get_global_id(0) * RUN;
  const int row = (int)get_global_id(1);
  if (x0 >= g.width)
  {
    return;
  }
  global const short* xy = xy_table + 2 * ((size_t)row * g.width + x0);
  global const ushort* fraction = fraction_table + (size_t)row * g.width + x0;
  global uchar* out = destination + (size_t)row * g.stride + 3 * x0;
  if (x0 + RUN > g.width)
  {
    guardedRun(source, &g, 3, xy, fraction, g.width - x0, out);
    return;
  }
  const int16 point = vload16(0, (global const int*)xy);
  const int16 x = point << 16 >> 16;
  const int16 y = point >> 16;
  // The six bytes of two neighbours come as eight, which may not pass the end of the row.
  if (!runInside(&g, 3, x, y))
  {
    guardedRun(source, &g, 3, xy, fraction, RUN, out);
    return;
  }
  int offset[RUN];
  vstore16(y * g.source_stride + x * 3, 0, offset);
  for (int i = 0; i < RUN; ++i)
  {
    const ushort ax = fraction[i] & 31;
    const ushort ay = fraction[i] >> 5;
    const ushort8 column = convert_ushort8(vload8(0, source + offset[i])) * (ushort)(32 - ay) +
                           convert_ushort8(vload8(0, source + offset[i] + g.source_stride)) * ay;
    const uint4 sum = convert_uint4(column.s0123) * (uint)(32 - ax) + convert_uint4(column.s3456) * (uint)ax;
    const uchar4 pixel = convert_uchar4((sum + 512u) >> 10u);
    vstore3(pixel.xyz, i, out);
  }
}
