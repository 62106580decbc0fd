#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime::kernels
{

/// Most levels of a pyramid, the full image included.
constexpr int MAX_PYRAMID_LEVELS = 8;

/// Where one level of a pyramid lies in the pyramid's buffer.
struct PyramidLevel
{
  int width;      ///< [px]
  int height;     ///< [px]
  size_t stride;  ///< from row to row [B], a multiple of 64
  size_t offset;  ///< of the first pixel from the start of the buffer [B], a multiple of 64
};

/// A pyramid of 8-bit images of one channel in one buffer: the full image first, then each level with half the size,
/// rounded up. Behind the last row of the last level lie 64 bytes more, so that vectors may be read past a row's end.
struct PyramidLayout
{
  /// @throws std::invalid_argument if width or height is not in [1, 32768], or levels not in [1, MAX_PYRAMID_LEVELS].
  PyramidLayout(int width, int height, int levels);

  int levels;
  std::array<PyramidLevel, MAX_PYRAMID_LEVELS> level;
  size_t bytes;  ///< of the whole buffer

  ImageView<const uint8_t> view(const uint8_t* pyramid, int index) const;
  ImageView<uint8_t> view(uint8_t* pyramid, int index) const;
};

/// Next smaller level of an image (Burt & Adelson 1983, with the kernel [1 4 6 4 1] / 16 in both directions, rounded
/// once at the end). Pixels outside are mirrored at the outermost pixel (BORDER_REFLECT_101). Equals cv::pyrDown.
/// @param source  8 bit, one channel.
/// @param destination  (width + 1) / 2 x (height + 1) / 2, apart from the source.
/// @param begin_row,end_row  rows of the destination to compute.
void pyramidDown(const ImageView<const uint8_t>& source, const ImageView<uint8_t>& destination, int begin_row,
                 int end_row);

/// All levels of an image into a buffer of layout.bytes.
/// @param image  of the layout's size.
void buildPyramid(const ImageView<const uint8_t>& image, const PyramidLayout& layout, uint8_t* pyramid);

/// Size and strides of the images of the codelets below.
struct PyramidShape
{
  int32_t width;               ///< of the (larger) source image [px], 1 to 32768
  int32_t height;              ///< [px], 1 to 32768
  int32_t source_stride;       ///< [B], at least width
  int32_t destination_stride;  ///< [B], at least (width + 1) / 2. Not used by image_pyramid.
  int32_t levels;              ///< of image_pyramid. Not used by pyramid_down.
};

/// pyramid_down: pyramidDown() as a task. Range: rows of the destination; sliceable. Both implementations give the same
/// bytes, and those of cv::pyrDown.
///   0  in   source, height rows of source_stride bytes (the last one of width bytes)
///   1  out  destination, rows of destination_stride bytes
///   2       PyramidShape
CodeletPtr pyramidDownCodelet();

/// image_pyramid: buildPyramid() as a task. Range: 1. Both implementations give the same bytes. Bytes between the
/// rows and behind the last level stay unchanged.
///   0  in   image, height rows of source_stride bytes
///   1  out  pyramid, PyramidLayout(width, height, levels).bytes
///   2       PyramidShape
CodeletPtr imagePyramidCodelet();

}  // namespace pi_runtime::kernels
