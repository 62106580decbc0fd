#include <pi_runtime/kernels/pyramid.h>

#include <cstring>
#include <vector>

#include "kernels/border.h"
#include "kernels/codelet_arguments.h"
#include "kernels/simd.h"

namespace pi_runtime::kernels
{
namespace
{

/// Columns of the weighted sum of five rows that are kept free on each side for mirrored ones.
constexpr int MARGIN = 2;

// All sums stay below 2^16: 16 * 16 * 255 + 128 = 65408.
PI_RUNTIME_SIMD_CLONES
void addRows(const uint8_t* __restrict a, const uint8_t* __restrict b, const uint8_t* __restrict c,
             const uint8_t* __restrict d, const uint8_t* __restrict e, uint16_t* __restrict sum, int width)
{
  for (int x = 0; x < width; ++x)
  {
    sum[x] = static_cast<uint16_t>(a[x] + e[x] + 4 * (b[x] + d[x]) + 6 * c[x]);
  }
}

/// @param sum  of the column of the source that lies MARGIN left of the first pixel.
PI_RUNTIME_SIMD_CLONES
void reduceRow(const uint16_t* __restrict sum, uint8_t* __restrict out, int width)
{
  for (int x = 0; x < width; ++x)
  {
    const uint16_t* s = sum + 2 * x;
    out[x] = static_cast<uint8_t>(static_cast<uint16_t>(s[0] + 4 * s[1] + 6 * s[2] + 4 * s[3] + s[4] + 128) >> 8);
  }
}

int half(int size)
{
  return (size + 1) / 2;
}

}  // namespace

PyramidLayout::PyramidLayout(int width, int height, int level_count) : levels(level_count), level{}, bytes(0)
{
  requireBetween("PyramidLayout", "width", width, 1, 32768);
  requireBetween("PyramidLayout", "height", height, 1, 32768);
  requireBetween("PyramidLayout", "levels", levels, 1, MAX_PYRAMID_LEVELS);
  for (int i = 0; i < levels; ++i)
  {
    const size_t stride = roundUp(static_cast<size_t>(width), 64);
    level[i] = PyramidLevel{width, height, stride, bytes};
    bytes += stride * static_cast<size_t>(height);
    width = half(width);
    height = half(height);
  }
  bytes += 64;
}

ImageView<const uint8_t> PyramidLayout::view(const uint8_t* pyramid, int index) const
{
  const PyramidLevel& at = level.at(index);
  return {pyramid + at.offset, at.width, at.height, at.stride, 1};
}

ImageView<uint8_t> PyramidLayout::view(uint8_t* pyramid, int index) const
{
  const PyramidLevel& at = level.at(index);
  return {pyramid + at.offset, at.width, at.height, at.stride, 1};
}

void pyramidDown(const ImageView<const uint8_t>& source, const ImageView<uint8_t>& destination, int begin_row,
                 int end_row)
{
  const int width = source.width;
  std::vector<uint16_t> sums(static_cast<size_t>(width) + 2 * MARGIN + 1);
  uint16_t* const sum = sums.data() + MARGIN;
  for (int y = begin_row; y < end_row; ++y)
  {
    const uint8_t* rows[5];
    for (int i = 0; i < 5; ++i)
    {
      rows[i] = source.row(reflect101(2 * y + i - 2, source.height));
    }
    addRows(rows[0], rows[1], rows[2], rows[3], rows[4], sum, width);
    for (int i = 1; i <= MARGIN; ++i)
    {
      sum[-i] = sum[reflect101(-i, width)];
      sum[width - 1 + i] = sum[reflect101(width - 1 + i, width)];
    }
    reduceRow(sums.data(), destination.row(y), half(width));
  }
}

void buildPyramid(const ImageView<const uint8_t>& image, const PyramidLayout& layout, uint8_t* pyramid)
{
  const ImageView<uint8_t> full = layout.view(pyramid, 0);
  for (int y = 0; y < full.height; ++y)
  {
    std::memcpy(full.row(y), image.row(y), static_cast<size_t>(full.width));
  }
  for (int i = 1; i < layout.levels; ++i)
  {
    const ImageView<uint8_t> smaller = layout.view(pyramid, i);
    pyramidDown(layout.view(static_cast<const uint8_t*>(pyramid), i - 1), smaller, 0, smaller.height);
  }
}

}  // namespace pi_runtime::kernels
