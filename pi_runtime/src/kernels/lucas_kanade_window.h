#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime::kernels
{

/// Rows in memory are a number of whole vectors long, of patches with some pixels more.
constexpr int WINDOW_STRIDE = 32;
constexpr int PATCH_STRIDE = 40;
constexpr int MAX_WINDOW_SIZE = 31;

/// Weights of the four pixels around a position, of 14 bits in sum.
struct BilinearWeights
{
  /// @param a,b  fractions of the position, in [0, 1).
  BilinearWeights(float a, float b);

  int32_t top_left;
  int32_t top_right;
  int32_t bottom_left;
  int32_t bottom_right;
};

/// Cuts patches out of an image. They hold floats although all sums of pixels with weights of 14 bits are whole
/// numbers: these stay below 2^24, so floats are exact, and multiplying 32-bit integers takes vector units twice as
/// long.
class PatchCutter
{
public:
  /// @param image  behind which 64 bytes must be readable.
  explicit PatchCutter(const ImageView<const uint8_t>& image) : image_(image) {}

  /// The square of `size` pixels from (x, y) on, up to MAX_WINDOW_SIZE + 3, with mirrored pixels outside of the image.
  /// Rows are PATCH_STRIDE apart. Valid until the next call.
  const float* cut(int x, int y, int size);
  const ImageView<const uint8_t>& image() const { return image_; }

private:
  const ImageView<const uint8_t> image_;
  // What the patch holds: most steps of a search stay within a pixel.
  int x_ = 0;
  int y_ = 0;
  int size_ = 0;
  alignas(64) float patch_[PATCH_STRIDE * (MAX_WINDOW_SIZE + 3)];
};

/// Elements of the symmetric matrix of the gradients' products, summed over the window.
struct GradientSums
{
  int64_t xx;
  int64_t xy;
  int64_t yy;
};

/// What the next image is compared with: the window around a point of the previous image at subpixel position, and its
/// gradients. Columns from `size` on have gradients of 0.
struct Window
{
  int size;
  alignas(64) int32_t pixel[WINDOW_STRIDE * MAX_WINDOW_SIZE];  ///< grey levels times 32
  alignas(64) int32_t dx[WINDOW_STRIDE * MAX_WINDOW_SIZE];     ///< grey levels per pixel times 32
  alignas(64) int32_t dy[WINDOW_STRIDE * MAX_WINDOW_SIZE];     ///< grey levels per pixel times 32
};

/// Cuts the window of window->size pixels with its upper left corner at (x, y) + weights out of the image.
GradientSums cutWindow(PatchCutter* cutter, int x, int y, const BilinearWeights& weights, Window* window);

/// Sums over the window of (next - previous) * gradient.
struct Mismatch
{
  int64_t x;
  int64_t y;
};

/// @param next  patch of size + 1 pixels.
Mismatch compareWindow(const Window& window, const float* next, const BilinearWeights& weights);

/// Sum over the window of |next - previous|, times 32.
int64_t absoluteDifference(const Window& window, const float* next, const BilinearWeights& weights);

}  // namespace pi_runtime::kernels
