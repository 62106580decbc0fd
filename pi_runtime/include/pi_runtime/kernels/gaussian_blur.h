#pragma once

#include <cstdint>

#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime::kernels
{

/// Gaussian of 7 x 7 px, sigma 2, with the weights 18 34 48 56 48 34 18 (of 256) in both directions; the exact sum is
/// rounded once. Borders are mirrored (reflect 101). Bit-exact with cv::GaussianBlur(Size(7, 7), 2, 2) for 8 bit.
/// @param source       one channel
/// @param destination  same size; must not overlap source
/// @param begin, end   rows of destination to make
void gaussianBlur7(const ImageView<const uint8_t>& source, const ImageView<uint8_t>& destination, int begin, int end);

}  // namespace pi_runtime::kernels
