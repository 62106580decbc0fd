#include "kernels/lucas_kanade_window.h"

#include <cmath>
#include <cstdlib>

#include "kernels/border.h"
#include "kernels/simd.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr int WEIGHT_BITS = 14;
constexpr int PIXEL_BITS = 5;  ///< fraction of interpolated pixels

/// Gradients at whole pixels, one row and column more than the window.
struct Gradients
{
  alignas(64) int32_t dx[PATCH_STRIDE * (MAX_WINDOW_SIZE + 1)];
  alignas(64) int32_t dy[PATCH_STRIDE * (MAX_WINDOW_SIZE + 1)];
};

/// Weights for pixels in floats, scaled so that sums are pixels with PIXEL_BITS of fraction.
struct PixelWeights
{
  explicit PixelWeights(const BilinearWeights& w)
    : top_left(scaled(w.top_left))
    , top_right(scaled(w.top_right))
    , bottom_left(scaled(w.bottom_left))
    , bottom_right(scaled(w.bottom_right))
  {
  }
  static float scaled(int32_t weight) { return static_cast<float>(weight) / (1 << (WEIGHT_BITS - PIXEL_BITS)); }

  float top_left;
  float top_right;
  float bottom_left;
  float bottom_right;
};

/// Rounds half up, as pixels are not negative.
PI_RUNTIME_ALWAYS_INLINE int32_t interpolatePixel(const float* top, int x, const PixelWeights& w)
{
  const float* bottom = top + PATCH_STRIDE;
  return static_cast<int32_t>(top[x] * w.top_left + top[x + 1] * w.top_right + bottom[x] * w.bottom_left +
                              bottom[x + 1] * w.bottom_right + 0.5f);
}

/// Gradients need 26 bits: too many for floats.
PI_RUNTIME_ALWAYS_INLINE int32_t interpolateGradient(const int32_t* top, int x, const BilinearWeights& w)
{
  const int32_t* bottom = top + PATCH_STRIDE;
  return (top[x] * w.top_left + top[x + 1] * w.top_right + bottom[x] * w.bottom_left + bottom[x + 1] * w.bottom_right +
          (1 << (WEIGHT_BITS - 1))) >>
         WEIGHT_BITS;
}

PI_RUNTIME_SIMD_CLONES
void convertRow(const uint8_t* __restrict from, float* __restrict to)
{
  for (int x = 0; x < PATCH_STRIDE; ++x)
  {
    to[x] = from[x];
  }
}

/// Scharr's gradients [-3 0 3; -10 0 10; -3 0 3] and transposed: 32 times the grey levels per pixel.
/// @param patch  from one pixel left of and above the first gradient on.
PI_RUNTIME_SIMD_CLONES
void scharr(const float* patch, int rows, Gradients* gradients)
{
  for (int y = 0; y < rows; ++y)
  {
    const float* __restrict r0 = patch + y * PATCH_STRIDE;
    const float* __restrict r1 = r0 + PATCH_STRIDE;
    const float* __restrict r2 = r1 + PATCH_STRIDE;
    int32_t* __restrict dx = gradients->dx + y * PATCH_STRIDE;
    int32_t* __restrict dy = gradients->dy + y * PATCH_STRIDE;
    for (int x = 0; x < WINDOW_STRIDE; ++x)
    {
      dx[x] = static_cast<int32_t>(3 * (r0[x + 2] - r0[x] + r2[x + 2] - r2[x]) + 10 * (r1[x + 2] - r1[x]));
      dy[x] = static_cast<int32_t>(3 * (r2[x] - r0[x] + r2[x + 2] - r0[x + 2]) + 10 * (r2[x + 1] - r0[x + 1]));
    }
    dx[WINDOW_STRIDE] = dy[WINDOW_STRIDE] = 0;  // read with the last column of the widest rows, but never used
  }
}

/// Sets gradients at pixels outside of the image to 0.
void clearOutside(const ImageView<const uint8_t>& image, int x, int y, int size, Gradients* gradients)
{
  for (int row = 0; row < size; ++row)
  {
    for (int column = 0; column < size; ++column)
    {
      if (x + column < 0 || x + column >= image.width || y + row < 0 || y + row >= image.height)
      {
        gradients->dx[row * PATCH_STRIDE + column] = 0;
        gradients->dy[row * PATCH_STRIDE + column] = 0;
      }
    }
  }
}

PI_RUNTIME_SIMD_CLONES
void interpolateWindow(const float* patch, const Gradients& gradients, const BilinearWeights& weights, Window* window)
{
  const BilinearWeights w = weights;
  const PixelWeights pixel_weights(w);
  const int size = window->size;
  for (int y = 0; y < size; ++y)
  {
    const float* __restrict p = patch + y * PATCH_STRIDE;
    const int32_t* __restrict dx = gradients.dx + y * PATCH_STRIDE;
    const int32_t* __restrict dy = gradients.dy + y * PATCH_STRIDE;
    int32_t* __restrict pixel = window->pixel + y * WINDOW_STRIDE;
    int32_t* __restrict out_dx = window->dx + y * WINDOW_STRIDE;
    int32_t* __restrict out_dy = window->dy + y * WINDOW_STRIDE;
    for (int x = 0; x < WINDOW_STRIDE; ++x)
    {
      pixel[x] = interpolatePixel(p, x, pixel_weights);
      out_dx[x] = interpolateGradient(dx, x, w) & (x < size ? -1 : 0);
      out_dy[x] = interpolateGradient(dy, x, w) & (x < size ? -1 : 0);
    }
  }
}

/// Adds up the columns' sums, which fit in 32 bits: 31 products below 2^25 (compareWindow) or 2^24 (sumGradients).
PI_RUNTIME_ALWAYS_INLINE int64_t total(const int32_t* columns, int count)
{
  int64_t sum = 0;
  for (int x = 0; x < count; ++x)
  {
    sum += columns[x];
  }
  return sum;
}

PI_RUNTIME_SIMD_CLONES
void sumGradients(const Window& window, GradientSums* sums)
{
  int32_t xx[WINDOW_STRIDE] = {};
  int32_t xy[WINDOW_STRIDE] = {};
  int32_t yy[WINDOW_STRIDE] = {};
  for (int y = 0; y < window.size; ++y)
  {
    const int32_t* __restrict dx = window.dx + y * WINDOW_STRIDE;
    const int32_t* __restrict dy = window.dy + y * WINDOW_STRIDE;
    for (int x = 0; x < WINDOW_STRIDE; ++x)
    {
      xx[x] += dx[x] * dx[x];
      xy[x] += dx[x] * dy[x];
      yy[x] += dy[x] * dy[x];
    }
  }
  *sums = GradientSums{total(xx, WINDOW_STRIDE), total(xy, WINDOW_STRIDE), total(yy, WINDOW_STRIDE)};
}

template <int COLUMNS>
PI_RUNTIME_ALWAYS_INLINE void compareColumns(const Window& window, const float* next, const BilinearWeights& weights,
                                             Mismatch* mismatch)
{
  const PixelWeights w(weights);
  int32_t sum_x[COLUMNS] = {};
  int32_t sum_y[COLUMNS] = {};
  for (int y = 0; y < window.size; ++y)
  {
    const float* __restrict p = next + y * PATCH_STRIDE;
    const int32_t* __restrict pixel = window.pixel + y * WINDOW_STRIDE;
    const int32_t* __restrict dx = window.dx + y * WINDOW_STRIDE;
    const int32_t* __restrict dy = window.dy + y * WINDOW_STRIDE;
    for (int x = 0; x < COLUMNS; ++x)
    {
      const int32_t difference = interpolatePixel(p, x, w) - pixel[x];
      sum_x[x] += difference * dx[x];
      sum_y[x] += difference * dy[x];
    }
  }
  *mismatch = Mismatch{total(sum_x, COLUMNS), total(sum_y, COLUMNS)};
}

PI_RUNTIME_SIMD_CLONES
void compareRows(const Window& window, const float* next, const BilinearWeights& weights, Mismatch* mismatch)
{
  if (window.size <= 16)
  {
    compareColumns<16>(window, next, weights, mismatch);
  }
  else if (window.size <= 24)
  {
    compareColumns<24>(window, next, weights, mismatch);
  }
  else
  {
    compareColumns<32>(window, next, weights, mismatch);
  }
}

}  // namespace

BilinearWeights::BilinearWeights(float a, float b)
{
  const float one = 1 << WEIGHT_BITS;
  top_left = static_cast<int32_t>(std::lrint((1.0f - a) * (1.0f - b) * one));
  top_right = static_cast<int32_t>(std::lrint(a * (1.0f - b) * one));
  bottom_left = static_cast<int32_t>(std::lrint((1.0f - a) * b * one));
  bottom_right = (1 << WEIGHT_BITS) - top_left - top_right - bottom_left;
}

const float* PatchCutter::cut(int x, int y, int size)
{
  if (x == x_ && y == y_ && size == size_)
  {
    return patch_;
  }
  x_ = x;
  y_ = y;
  size_ = size;
  if (x >= 0 && y >= 0 && x + size <= image_.width && y + size <= image_.height)
  {
    for (int row = 0; row < size; ++row)
    {
      convertRow(image_.row(y + row) + x, patch_ + row * PATCH_STRIDE);
    }
    return patch_;
  }
  int columns[PATCH_STRIDE];
  for (int column = 0; column < PATCH_STRIDE; ++column)
  {
    columns[column] = reflect101(x + column, image_.width);
  }
  for (int row = 0; row < size; ++row)
  {
    const uint8_t* from = image_.row(reflect101(y + row, image_.height));
    float* to = patch_ + row * PATCH_STRIDE;
    for (int column = 0; column < PATCH_STRIDE; ++column)
    {
      to[column] = from[columns[column]];
    }
  }
  return patch_;
}

GradientSums cutWindow(PatchCutter* cutter, int x, int y, const BilinearWeights& weights, Window* window)
{
  const int size = window->size;
  const float* around = cutter->cut(x - 1, y - 1, size + 3);
  Gradients gradients;
  scharr(around, size + 1, &gradients);
  const ImageView<const uint8_t>& image = cutter->image();
  if (x < 0 || y < 0 || x + size >= image.width || y + size >= image.height)
  {
    clearOutside(image, x, y, size + 1, &gradients);
  }
  interpolateWindow(around + PATCH_STRIDE + 1, gradients, weights, window);
  GradientSums sums;
  sumGradients(*window, &sums);
  return sums;
}

Mismatch compareWindow(const Window& window, const float* next, const BilinearWeights& weights)
{
  Mismatch mismatch;
  compareRows(window, next, weights, &mismatch);
  return mismatch;
}

int64_t absoluteDifference(const Window& window, const float* next, const BilinearWeights& weights)
{
  const PixelWeights w(weights);
  int64_t sum = 0;
  for (int y = 0; y < window.size; ++y)
  {
    for (int x = 0; x < window.size; ++x)
    {
      sum += std::abs(interpolatePixel(next + y * PATCH_STRIDE, x, w) - window.pixel[y * WINDOW_STRIDE + x]);
    }
  }
  return sum;
}

}  // namespace pi_runtime::kernels
