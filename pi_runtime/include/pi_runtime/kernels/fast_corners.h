#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime::kernels
{

struct Corner
{
  uint16_t x;     ///< [px]
  uint16_t y;     ///< [px]
  int32_t score;  ///< largest threshold with which it is a corner, 0 to 254
};

/// FAST-9 corners (Rosten & Drummond 2006): pixels for which at least 9 neighbouring pixels of the circle of 16 pixels
/// around them are all brighter than the pixel by more than the threshold, or all darker. Only corners with a score
/// above that of all 8 neighbours are kept. Same corners and scores as cv::FAST with TYPE_9_16 and non-maximum
/// suppression. Pixels less than 3 px from the border are no corners.
/// @param image  8 bit, one channel, at most 65535 wide and high.
/// @param threshold  0 to 254.
/// @param corners  the first `capacity` ones, ordered by row, then column.
/// @return the number of corners found, which may be larger than capacity.
size_t findFastCorners(const ImageView<const uint8_t>& image, int threshold, Corner* corners, size_t capacity);

/// Image, threshold and room for the result of the codelet below.
struct FastCornersShape
{
  int32_t width;      ///< [px], 1 to 32768
  int32_t height;     ///< [px], 1 to 32768
  int32_t stride;     ///< [B], at least width
  int32_t threshold;  ///< 0 to 254; 10 to 30 are usual
  int32_t capacity;   ///< of the list of corners, at least 1
};

/// Bytes of working memory for an image of this size. 0 if it is too small for corners.
size_t fastCornersWorkBytes(int width, int height);

/// fast_corners: findFastCorners() as a task. Range: 1. Both implementations give the same list.
///   0  in   image, height rows of stride bytes
///   1  out  Corner[capacity]; elements behind the found ones stay unchanged
///   2  out  uint32_t: number of corners found, perhaps above capacity
///   3  out  working memory, max(1, fastCornersWorkBytes(width, height)); content undefined afterwards
///   4       FastCornersShape
CodeletPtr fastCornersCodelet();

}  // namespace pi_runtime::kernels
