// Next smaller level of an image: see pi_runtime/kernels/pyramid.h. Needs prelude.cl in front.
// All sums stay below 2^16.

// Pairs of neighbouring pixels: the even one in the low byte (devices are little-endian), the odd one in the high byte.
INLINE ushort16 loadPairs(global const uchar* from)
{
  return (ushort16)(as_ushort8(LOAD16(from)), as_ushort8(LOAD16(from + 16)));
}

INLINE ushort pair(uchar even, uchar odd)
{
  return (ushort)(even | (odd << 8));
}

INLINE ushort16 shiftIn(ushort first, ushort16 pairs)
{
  return (ushort16)(first, pairs.s0123, pairs.s4567, pairs.s89ab, pairs.scde);
}

INLINE ushort16 shiftOut(ushort16 pairs, ushort last)
{
  return (ushort16)(pairs.s1234, pairs.s5678, pairs.s9abc, pairs.sdef, last);
}

// Horizontal sums of the 16 pixels whose middle columns are first, first + 2, ... At the ends of a row the pairs that
// reach outside are made of others, without a load there.
INLINE ushort16 sumRow(global const uchar* row, int first, int width)
{
  ushort16 before;
  ushort16 at;
  ushort16 behind;
  if (first == 0)
  {
    at = loadPairs(row);
    before = shiftIn(pair(row[2], row[1]), at);
  }
  else
  {
    before = loadPairs(row + first - 2);
    at = first + 32 <= width ? loadPairs(row + first) : shiftOut(before, pair(row[width - 1], row[width - 2]));
  }
  behind = first + 34 <= width ? loadPairs(row + first + 2) : shiftOut(at, row[reflect101(first + 32, width)]);
  const ushort16 even = (ushort)255;
  return (before & even) + (behind & even) + (at & even) * (ushort)6 + ((before >> 8) + (at >> 8)) * (ushort)4;
}

// 16 x ROWS pixels per item, for destinations at least 17 wide. The last item of a row starts earlier so that it ends
// with the row: it writes what its neighbour writes, too.
kernel void pyramid_down(global const uchar* restrict source, ulong source_offset, int source_stride, int width,
                         int height, global uchar* restrict destination, ulong destination_offset,
                         int destination_stride, int begin_row, int end_row)
{
  const int smaller_width = (width + 1) / 2;
  if (get_global_id(0) * 16 >= smaller_width)
  {
    return;
  }
  const int x = min((int)get_global_id(0) * 16, smaller_width - 16);
  int y = begin_row + (int)get_global_id(1) * ROWS;
  const int end = min(y + ROWS, end_row);
  source += source_offset;
  destination += destination_offset;
#define SUM_ROW(row) sumRow(source + (size_t)reflect101(row, height) * source_stride, 2 * x, width)
  ushort16 sum0 = SUM_ROW(2 * y - 2);
  ushort16 sum1 = SUM_ROW(2 * y - 1);
  ushort16 sum2 = SUM_ROW(2 * y);
  for (; y < end; ++y)
  {
    const ushort16 sum3 = SUM_ROW(2 * y + 1);
    const ushort16 sum4 = SUM_ROW(2 * y + 2);
    const ushort16 sum = sum0 + sum4 + (sum1 + sum3) * (ushort)4 + sum2 * (ushort)6 + (ushort)128;
    STORE16(destination + (size_t)y * destination_stride + x, convert_uchar16(sum >> (ushort)8));
    sum0 = sum2;
    sum1 = sum3;
    sum2 = sum4;
  }
}

// One pixel per item, for destinations less than 17 wide.
kernel void pyramid_down_narrow(global const uchar* restrict source, ulong source_offset, int source_stride, int width,
                                int height, global uchar* restrict destination, ulong destination_offset,
                                int destination_stride, int begin_row, int end_row)
{
  const int x = get_global_id(0);
  const int y = begin_row + (int)get_global_id(1);
  const uint weights[5] = {1, 4, 6, 4, 1};
  uint sum = 128;
  for (int i = 0; i < 5; ++i)
  {
    global const uchar* row = source + source_offset + (size_t)reflect101(2 * y + i - 2, height) * source_stride;
    for (int k = 0; k < 5; ++k)
    {
      sum += weights[i] * weights[k] * row[reflect101(2 * x + k - 2, width)];
    }
  }
  destination[destination_offset + (size_t)y * destination_stride + x] = (uchar)(sum >> 8);
}

// The full image into a pyramid: 64 pixels of a row per item. The pyramid's rows have room for whole blocks, the
// image's have not.
kernel void pyramid_copy(global const uchar* restrict image, int stride, int width, global uchar* restrict pyramid,
                         int pyramid_stride)
{
  const int begin = (int)get_global_id(0) * 64;
  const size_t y = get_global_id(1);
  global const uchar* from = image + y * stride;
  global uchar* to = pyramid + y * pyramid_stride;
  if (begin + 64 <= width)
  {
    for (int x = begin; x < begin + 64; x += 16)
    {
      STORE16(to + x, LOAD16(from + x));
    }
  }
  else
  {
    for (int x = begin; x < width; ++x)
    {
      to[x] = from[x];
    }
  }
}
