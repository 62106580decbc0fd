#pragma once

#include <cstdint>

#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime
{
namespace kernels
{

/// Gaussian of 7 x 7 px, sigma 2, with the weights 18 34 48 56 48 34 18 (of 256) in both directions; the exact sum is
/// rounded once. Borders are mirrored (reflect 101). Bit-exact with cv::GaussianBlur(Size(7, 7), 2, 2) for 8 bit.
/// @param source       one channel
/// @param destination  same size; must not overlap source
/// @param begin, end   rows of destination to make
void gaussianBlur7(const ImageView<const uint8_t>& source, const ImageView<uint8_t>& destination, int begin, int end);

/// Argument 2 of the codelet. Strides in bytes.
struct BlurGeometry
{
  int32_t width;
  int32_t height;
  int32_t source_stride;
  int32_t stride;  ///< of the destination
};

/// "gaussian_blur7": gaussianBlur7() above. Range: rows; sliceable. Both implementations give the same bits.
///   0 in   source, uint8
///   1 out  destination, uint8 (inOut if the bytes between rows matter)
///   2      BlurGeometry
CodeletPtr gaussianBlur7Codelet();

}  // namespace kernels
}  // namespace pi_runtime
