#include <pi_runtime/kernels/fast_corners.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "kernels/simd.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr int RADIUS = 3;        ///< of the circle [px]
constexpr int CIRCLE = 16;       ///< pixels of the circle
constexpr int BLOCK_WIDTH = 64;  ///< pixels that are looked at together: one vector of the widest kind

using Circle = std::array<ptrdiff_t, CIRCLE>;

/// Offsets of the circle's pixels from its centre, clockwise from the top.
Circle circleOffsets(size_t image_stride)
{
  const auto stride = static_cast<ptrdiff_t>(image_stride);
  return {-3 * stride,     -3 * stride + 1, -2 * stride + 2, -stride + 3,    3,          stride + 3, 2 * stride + 2,
          3 * stride + 1,  3 * stride,      3 * stride - 1,  2 * stride - 2, stride - 3, -3,         -stride - 3,
          -2 * stride - 2, -3 * stride - 1};
}

PI_RUNTIME_ALWAYS_INLINE uint8_t lower(uint8_t a, uint8_t b)
{
  return a < b ? a : b;
}

PI_RUNTIME_ALWAYS_INLINE uint8_t higher(uint8_t a, uint8_t b)
{
  return a > b ? a : b;
}

/// The larger of: how far `bright` is above v, how far `dark` is below it; 0 if neither.
PI_RUNTIME_ALWAYS_INLINE uint8_t contrast(uint8_t v, uint8_t bright, uint8_t dark)
{
  return higher(static_cast<uint8_t>(higher(bright, v) - v), static_cast<uint8_t>(v - lower(dark, v)));
}

/// An upper bound of the contrast of every pixel of a block: each arc of 9 has one pixel of each two opposite ones.
PI_RUNTIME_ALWAYS_INLINE uint8_t boundOfBlock(const uint8_t* __restrict pixel, const Circle& circle)
{
  uint8_t bound = 0;
  for (int i = 0; i < BLOCK_WIDTH; ++i)
  {
    const uint8_t* p = pixel + i;
    const uint8_t top = p[circle[0]];
    const uint8_t bottom = p[circle[8]];
    const uint8_t right = p[circle[4]];
    const uint8_t left = p[circle[12]];
    const uint8_t bright = lower(higher(top, bottom), higher(left, right));
    const uint8_t dark = higher(lower(top, bottom), lower(left, right));
    bound = higher(bound, contrast(*p, bright, dark));
  }
  return bound;
}

/// Scores of a block. With B the largest minimum over the arcs of 9 pixels and D the smallest maximum, the pixel v is a
/// corner for thresholds below max(B - v, v - D). Two arcs that share 8 pixels share their minimum: min(a, b, m) and
/// min(b, m, c) have the maximum min(m, max(a, c)).
PI_RUNTIME_ALWAYS_INLINE void scoreBlock(const uint8_t* __restrict pixel, const Circle& circle, uint8_t threshold,
                                         uint8_t* __restrict score, int width)
{
  const uint8_t* circle_pixel[CIRCLE];  // not indices: the compiler would read them again for every pixel
#pragma GCC unroll 16
  for (int k = 0; k < CIRCLE; ++k)
  {
    circle_pixel[k] = pixel + circle[k];
  }
  for (int i = 0; i < width; ++i)
  {
    uint8_t c[CIRCLE];
#pragma GCC unroll 16
    for (int k = 0; k < CIRCLE; ++k)
    {
      c[k] = circle_pixel[k][i];
    }
    uint8_t low2[8];
    uint8_t high2[8];
#pragma GCC unroll 8
    for (int k = 0; k < 8; ++k)  // of the pixels 2k + 1, 2k + 2
    {
      low2[k] = lower(c[2 * k + 1], c[(2 * k + 2) % CIRCLE]);
      high2[k] = higher(c[2 * k + 1], c[(2 * k + 2) % CIRCLE]);
    }
    uint8_t low4[8];
    uint8_t high4[8];
#pragma GCC unroll 8
    for (int k = 0; k < 8; ++k)
    {
      low4[k] = lower(low2[k], low2[(k + 1) % 8]);
      high4[k] = higher(high2[k], high2[(k + 1) % 8]);
    }
    uint8_t bright = 0;
    uint8_t dark = 255;
#pragma GCC unroll 8
    for (int k = 0; k < 8; ++k)  // the pixels 2k + 1 to 2k + 8, with 2k or 2k + 9
    {
      const uint8_t before = c[2 * k];
      const uint8_t behind = c[(2 * k + 9) % CIRCLE];
      bright = higher(bright, lower(lower(low4[k], low4[(k + 2) % 8]), higher(before, behind)));
      dark = lower(dark, higher(higher(high4[k], high4[(k + 2) % 8]), lower(before, behind)));
    }
    const uint8_t found = contrast(pixel[i], bright, dark);
    score[i] = found > threshold ? static_cast<uint8_t>(found - 1) : 0;
  }
}

/// Scores of a row of pixels, block by block. The last block begins earlier if it would not fit, and then finds the
/// same scores again; rows shorter than a block are not vectorised.
/// @param flags  per block: 1 if it may hold corners.
PI_RUNTIME_SIMD_CLONES
void scoreRow(const uint8_t* __restrict pixel, const Circle& circle, uint8_t threshold, uint8_t* __restrict score,
              uint8_t* __restrict flags, int width)
{
  if (width < BLOCK_WIDTH)
  {
    flags[0] = 1;
    scoreBlock(pixel, circle, threshold, score, width);
    return;
  }
  for (int x = 0; x < width; x += BLOCK_WIDTH)
  {
    const int first = x + BLOCK_WIDTH <= width ? x : width - BLOCK_WIDTH;
    flags[x / BLOCK_WIDTH] = boundOfBlock(pixel + first, circle) > threshold;
    if (flags[x / BLOCK_WIDTH] != 0)
    {
      scoreBlock(pixel + first, circle, threshold, score + first, BLOCK_WIDTH);
    }
    else
    {
      std::memset(score + first, 0, BLOCK_WIDTH);
    }
  }
}

/// The scores of three rows that follow each other, and where the middle one has some.
class ScoreRows
{
public:
  explicit ScoreRows(int width)
    : blocks_((width + BLOCK_WIDTH - 1) / BLOCK_WIDTH), stride_(static_cast<size_t>(blocks_) * BLOCK_WIDTH + 2 * MARGIN)
  {
    scores_.resize(3 * stride_);
    flags_.resize(static_cast<size_t>(3 * blocks_));
  }

  uint8_t* row(int y) { return scores_.data() + static_cast<size_t>(y % 3) * stride_ + MARGIN; }
  uint8_t* flags(int y) { return flags_.data() + (y % 3) * blocks_; }
  void clear(int y) { std::memset(row(y) - MARGIN, 0, stride_); }

  /// Calls found(x, score) for the maxima of row y, from left to right.
  template <typename Found>
  void maxima(int y, const Found& found)
  {
    const uint8_t* above = row(y + 2);
    const uint8_t* at = row(y);
    const uint8_t* below = row(y + 1);
    for (int x = 0; x < blocks_ * BLOCK_WIDTH; x += 8)
    {
      if (flags(y)[x / BLOCK_WIDTH] == 0)
      {
        x += BLOCK_WIDTH - 8;
        continue;
      }
      uint64_t eight;
      std::memcpy(&eight, at + x, 8);
      for (int i = x; eight != 0 && i < x + 8; ++i)
      {
        const uint8_t score = at[i];
        if (score > at[i - 1] && score > at[i + 1] && score > above[i - 1] && score > above[i] &&
            score > above[i + 1] && score > below[i - 1] && score > below[i] && score > below[i + 1])
        {
          found(i, score);
        }
      }
    }
  }

private:
  static constexpr size_t MARGIN = 16;
  const int blocks_;
  const size_t stride_;
  std::vector<uint8_t> scores_;
  std::vector<uint8_t> flags_;
};

}  // namespace

size_t findFastCorners(const ImageView<const uint8_t>& image, int threshold, Corner* corners, size_t capacity)
{
  const int width = image.width - 2 * RADIUS;
  const int height = image.height - 2 * RADIUS;
  if (width < 1 || height < 1)
  {
    return 0;
  }
  const Circle circle = circleOffsets(image.stride);
  ScoreRows rows(width);
  size_t count = 0;
  for (int y = 0; y <= height; ++y)
  {
    if (y < height)
    {
      scoreRow(image.row(y + RADIUS) + RADIUS, circle, static_cast<uint8_t>(threshold), rows.row(y), rows.flags(y),
               width);
    }
    else
    {
      rows.clear(y);
    }
    if (y == 0)
    {
      continue;
    }
    rows.maxima(y - 1,
                [&](int x, uint8_t score)
                {
                  if (count < capacity)
                  {
                    corners[count] = Corner{static_cast<uint16_t>(x + RADIUS), static_cast<uint16_t>(y - 1 + RADIUS),
                                            static_cast<int32_t>(score)};
                  }
                  ++count;
                });
  }
  return count;
}

}  // namespace pi_runtime::kernels
