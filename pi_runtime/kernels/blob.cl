// Image to network input: pi_runtime/kernels/blob.h has the contract, the arithmetic, and the layout of the plan.
// Needs prelude.cl in front.
// One work item makes RUN columns of one row, of all planes. Global size: runs (padded to whole groups) by rows.

#define RUN 16

typedef struct
{
  int source_width;
  int source_height;
  int source_stride;
  int channels;
  int width;
  int height;
  int letterbox;
} BlobGeometry;

typedef struct
{
  float mean[3];
  float scale[3];
  int swap_rb;
  int fill;
} BlobColours;

typedef struct
{
  int x;
  int y;
  int width;
  int height;
} BlobContent;

// Grey levels of one channel from the four neighbours, which lie in the lowest eight bits after the shift.
INLINE int16 blend(uint16 upper_left, uint16 upper_right, uint16 lower_left, uint16 lower_right, uint shift,
                   int16 first, int16 second, int upper_weight, int lower_weight)
{
  const int16 upper = (convert_int16(upper_left >> shift & 255u) * first +
                       convert_int16(upper_right >> shift & 255u) * second) >> 4;
  const int16 lower = (convert_int16(lower_left >> shift & 255u) * first +
                       convert_int16(lower_right >> shift & 255u) * second) >> 4;
  return ((upper * upper_weight >> 16) + (lower * lower_weight >> 16) + 2) >> 2;
}

// The levels of all channels at RUN columns from x on.
INLINE void levelsAt(global const uchar* source, global const int* plan, const BlobGeometry* g,
                     const BlobColours* colours, const BlobContent* content, const int channels, int x, int y,
                     int16* levels)
{
  if (y < content->y || y >= content->y + content->height)
  {
    levels[0] = levels[1] = levels[2] = (int16)(colours->fill);
    return;
  }
  const int columns = (g->width + RUN - 1) / RUN * RUN;
  global const int* rows = plan + 2 * columns + y;
  global const uchar* upper = source + (size_t)rows[0] * g->source_stride;
  global const uchar* lower = source + (size_t)rows[g->height] * g->source_stride;
  const int row_weights = rows[2 * g->height];
  const int16 weights = vload16(0, plan + columns + x);
  uint ul[RUN];
  uint ur[RUN];
  uint ll[RUN];
  uint lr[RUN];
#pragma unroll
  for (int i = 0; i < RUN; ++i)
  {
    const int offset = plan[x + i];
    if (channels == 3)
    {
      ul[i] = as_uint(vload4(0, upper + offset));
      ur[i] = as_uint(vload4(0, upper + offset + 2)) >> 8;
      ll[i] = as_uint(vload4(0, lower + offset));
      lr[i] = as_uint(vload4(0, lower + offset + 2)) >> 8;
    }
    else
    {
      ul[i] = upper[offset];
      ur[i] = upper[offset + 1];
      ll[i] = lower[offset];
      lr[i] = lower[offset + 1];
    }
  }
  const int16 column = x + (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  const int16 bar = column < content->x | column >= content->x + content->width;
  for (int channel = 0; channel < channels; ++channel)
  {
    const int16 level = blend(vload16(0, ul), vload16(0, ur), vload16(0, ll), vload16(0, lr), 8 * channel,
                              weights & 0xFFFF, weights >> 16, row_weights & 0xFFFF, row_weights >> 16);
    levels[channel] = select(level, (int16)(colours->fill), bar);
  }
}

INLINE float16 normalised(const BlobColours* colours, const int16* levels, int channels, int plane)
{
  const int channel = colours->swap_rb ? channels - 1 - plane : plane;
  return (convert_float16(levels[channel]) - colours->mean[plane]) * colours->scale[plane];
}

#define BLOB_KERNEL(NAME, CHANNELS)                                                                                 \
  kernel void NAME(global const uchar* source, global const int* plan, global float* destination,                   \
                   const BlobGeometry g, const BlobColours colours, const BlobContent content)                      \
  {                                                                                                                 \
    const int x = (int)get_global_id(0) * RUN;                                                                      \
    const int y = (int)get_global_id(1);                                                                            \
    if (x >= g.width)                                                                                               \
    {                                                                                                               \
      return;                                                                                                       \
    }                                                                                                               \
    int16 levels[3];                                                                                                \
    levelsAt(source, plan, &g, &colours, &content, CHANNELS, x, y, levels);                                         \
    for (int plane = 0; plane < CHANNELS; ++plane)                                                                  \
    {                                                                                                               \
      const float16 values = normalised(&colours, levels, CHANNELS, plane);                                         \
      global float* out = destination + ((size_t)plane * g.height + y) * g.width + x;                               \
      if (x + RUN <= g.width)                                                                                       \
      {                                                                                                             \
        vstore16(values, 0, out);                                                                                   \
        continue;                                                                                                   \
      }                                                                                                             \
      float rest[RUN];                                                                                              \
      vstore16(values, 0, rest);                                                                                    \
      for (int i = 0; x + i < g.width; ++i)                                                                         \
      {                                                                                                             \
        out[i] = rest[i];                                                                                           \
      }                                                                                                             \
    }                                                                                                               \
  }

BLOB_KERNEL(blob_float_1, 1)
BLOB_KERNEL(blob_float_3, 3)
