// Oriented BRIEF: pi_runtime/kernels/orb.h has the contract and the tables. Needs prelude.cl in front.
// orb_angles: one work item per point. orb_descriptors: ITEMS_PER_POINT of them, each for BITS_PER_ITEM tests.

#define BITS 256
#define RADIUS 15
#define BORDER 19
#define NO_ANGLE 256
#define ITEMS_PER_POINT 4
#define BITS_PER_ITEM (BITS / ITEMS_PER_POINT)

typedef struct
{
  short x[2 * BITS];
  short y[2 * BITS];
  short cosine[256];
  short sine[256];
  short column[31][32];
  short disc[31][32];
  int octant[32];
} OrbTables;

typedef struct
{
  int width;
  int height;
  int image_stride;
  int smoothed_stride;
  int points;
} OrbShape;

// Direction (m10, m01) in 256ths of a turn.
INLINE int angleOf(int m10, int m01, global const OrbTables* tables)
{
  const uint ax = abs(m10);
  const uint ay = abs(m01);
  const long low = min(ax, ay);
  const long high = max(ax, ay);
  int angle = 0;
  for (int i = 0; i < 32; ++i)
  {
    angle += low * (1 << 14) > tables->octant[i] * high ? 1 : 0;
  }
  angle = ax < ay ? 64 - angle : angle;
  angle = m10 < 0 ? 128 - angle : angle;
  return (m01 < 0 ? 256 - angle : angle) & 255;
}

kernel void orb_angles(global const uchar* image, global const float2* points, global const OrbTables* tables,
                       global ushort* angles, const OrbShape shape, const int begin, const int end)
{
  const int i = begin + (int)get_global_id(0);
  if (i >= end)
  {
    return;
  }
  const float2 p = rint(points[i]);
  const bool inside = p.x >= BORDER && p.y >= BORDER && p.x < shape.width - BORDER && p.y < shape.height - BORDER;
  if (!inside)
  {
    angles[i] = NO_ANGLE;
    return;
  }
  global const uchar* row =
      image + (size_t)((int)p.y - RADIUS) * shape.image_stride + ((int)p.x - RADIUS);
  int16 weighted = 0;
  int16 tilted = 0;
  for (int y = -RADIUS; y <= RADIUS; ++y, row += shape.image_stride)
  {
    const short16 left = convert_short16(LOAD16(row));
    const short16 right = convert_short16(LOAD16(row + 16));
    global const short* column = tables->column[y + RADIUS];
    global const short* disc = tables->disc[y + RADIUS];
    // At most 2 * 15 * 255: fits 16 bits.
    weighted += convert_int16(left * vload16(0, column) + right * vload16(1, column));
    tilted += convert_int16((left * vload16(0, disc) + right * vload16(1, disc)) * (short)y);
  }
  const int8 w8 = weighted.lo + weighted.hi;
  const int8 t8 = tilted.lo + tilted.hi;
  const int4 w4 = w8.lo + w8.hi;
  const int4 t4 = t8.lo + t8.hi;
  angles[i] = (ushort)angleOf(w4.x + w4.y + w4.z + w4.w, t4.x + t4.y + t4.z + t4.w, tables);
}

// Where 16 of the turned tests' pixels are, from the point.
INLINE int16 turnedOffsets(global const OrbTables* tables, int first, int c, int s, int stride)
{
  const int16 x = convert_int16(vload16(0, tables->x + first));
  const int16 y = convert_int16(vload16(0, tables->y + first));
  const int16 turned_x = (x * c - y * s + (1 << 13)) >> 14;
  const int16 turned_y = (x * s + y * c + (1 << 13)) >> 14;
  return turned_y * stride + turned_x;
}

kernel void orb_descriptors(global const uchar* smoothed, global const float2* points,
                            global const OrbTables* tables, global uchar* descriptors, global const ushort* angles,
                            const OrbShape shape, const int begin, const int end)
{
  const int i = begin + (int)get_global_id(0) / ITEMS_PER_POINT;
  const int part = (int)get_global_id(0) % ITEMS_PER_POINT;
  if (i >= end)
  {
    return;
  }
  global ushort* out = (global ushort*)(descriptors + 32 * (size_t)i) + part * BITS_PER_ITEM / 16;
  const int angle = angles[i];
  if (angle == NO_ANGLE)
  {
    for (int k = 0; k < BITS_PER_ITEM / 16; ++k)
    {
      out[k] = 0;
    }
    return;
  }
  const float2 p = rint(points[i]);
  global const uchar* centre = smoothed + (size_t)(int)p.y * shape.smoothed_stride + (int)p.x;
  const int c = tables->cosine[angle];
  const int s = tables->sine[angle];
  for (int k = 0; k < BITS_PER_ITEM / 16; ++k)
  {
    const int first = part * BITS_PER_ITEM + 16 * k;
    int a[16];
    int b[16];
    vstore16(turnedOffsets(tables, first, c, s, shape.smoothed_stride), 0, a);
    vstore16(turnedOffsets(tables, first + BITS, c, s, shape.smoothed_stride), 0, b);
    uint bits = 0;
#pragma unroll
    for (int bit = 0; bit < 16; ++bit)
    {
      bits |= centre[a[bit]] < centre[b[bit]] ? 1u << bit : 0u;
    }
    out[k] = (ushort)bits;
  }
}
