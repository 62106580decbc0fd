#include <pi_runtime/kernels/gaussian_blur.h>

#include <vector>

#include "kernels/border.h"
#include "kernels/simd.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr int BLUR_RADIUS = 3;
constexpr int TAPS = 2 * BLUR_RADIUS + 1;

/// The weighted sum of seven values, of which the outer ones are equal in pairs. At most 256 * 255: fits 16 bits.
PI_RUNTIME_ALWAYS_INLINE uint16_t weighted(int a, int b, int c, int d, int e, int f, int g)
{
  return static_cast<uint16_t>((a + g) * 18 + (b + f) * 34 + (c + e) * 48 + d * 56);
}

/// Down the columns; the sums are split in two bytes so that the next pass needs no more than 16 bits either.
PI_RUNTIME_SIMD_CLONES
void sumColumns(const uint8_t* const* rows, int width, uint16_t* __restrict high, uint16_t* __restrict low)
{
  const uint8_t* const __restrict a = rows[0];
  const uint8_t* const __restrict b = rows[1];
  const uint8_t* const __restrict c = rows[2];
  const uint8_t* const __restrict d = rows[3];
  const uint8_t* const __restrict e = rows[4];
  const uint8_t* const __restrict f = rows[5];
  const uint8_t* const __restrict g = rows[6];
  for (int x = 0; x < width; ++x)
  {
    const uint16_t sum = weighted(a[x], b[x], c[x], d[x], e[x], f[x], g[x]);
    high[x] = sum >> 8;
    low[x] = sum & 0xFF;
  }
}

/// Along the row. With S = 256 H + L, (S + 2^15) >> 16 is (H + 128 + (L >> 8)) >> 8, which stays below 2^16.
PI_RUNTIME_SIMD_CLONES
void sumRow(const uint16_t* __restrict high, const uint16_t* __restrict low, int width, uint8_t* __restrict out)
{
  for (int x = 0; x < width; ++x)
  {
    const uint16_t* const h = high + x;
    const uint16_t* const l = low + x;
    const uint16_t upper = weighted(h[0], h[1], h[2], h[3], h[4], h[5], h[6]);
    const uint16_t lower = weighted(l[0], l[1], l[2], l[3], l[4], l[5], l[6]);
    const auto sum = static_cast<uint16_t>(upper + 128 + (lower >> 8));
    out[x] = static_cast<uint8_t>(sum >> 8);
  }
}

/// @param values  width + 2 * BLUR_RADIUS elements, of which the middle ones are there
void mirrorEnds(uint16_t* values, int width)
{
  for (int i = 1; i <= BLUR_RADIUS; ++i)
  {
    values[BLUR_RADIUS - i] = values[BLUR_RADIUS + reflect101(-i, width)];
    values[BLUR_RADIUS + width - 1 + i] = values[BLUR_RADIUS + reflect101(width - 1 + i, width)];
  }
}

}  // namespace

void gaussianBlur7(const ImageView<const uint8_t>& source, const ImageView<uint8_t>& destination, int begin, int end)
{
  const int width = source.width;
  std::vector<uint16_t> high(width + 2 * BLUR_RADIUS);
  std::vector<uint16_t> low(width + 2 * BLUR_RADIUS);
  for (int y = begin; y < end; ++y)
  {
    const uint8_t* rows[TAPS];
    for (int tap = 0; tap < TAPS; ++tap)
    {
      rows[tap] = source.row(reflect101(y + tap - BLUR_RADIUS, source.height));
    }
    sumColumns(rows, width, high.data() + BLUR_RADIUS, low.data() + BLUR_RADIUS);
    mirrorEnds(high.data(), width);
    mirrorEnds(low.data(), width);
    sumRow(high.data(), low.data(), width, destination.row(y));
  }
}

}  // namespace pi_runtime::kernels
