#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/point.h>
#include <pi_runtime/kernels/pyramid.h>

namespace pi_runtime::kernels
{

constexpr int MAX_TRACK_WINDOW = 31;

/// How to track points. The pyramids have the layout PyramidLayout(width, height, levels).
struct TrackOptions
{
  int32_t width = 640;          ///< of the full image [px], 1 to 32768
  int32_t height = 480;         ///< [px], 1 to 32768
  int32_t levels = 4;           ///< 1 to MAX_PYRAMID_LEVELS; 1: no smaller images
  int32_t window = 21;          ///< side of the square around a point that is compared [px], 3 to MAX_TRACK_WINDOW
  int32_t max_iterations = 30;  ///< on each level, 1 to 100
  float epsilon = 0.01f;        ///< a step up to this length ends the search on a level [px]
  /// Windows with less texture are not tracked: smaller eigenvalue of the mean over the window of the gradient's outer
  /// product [(grey levels / px)^2], divided by 1024.
  float min_eigenvalue = 1e-4f;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Tracks points from one image to the next: sparse pyramidal Lucas-Kanade (Bouguet 2000), by the definition of
/// cv::calcOpticalFlowPyrLK with OPTFLOW_USE_INITIAL_FLOW: Scharr gradients that are 0 outside of the image, mirrored
/// pixels there, bilinear weights of 14 bits. On points that can be tracked both agree to about 0.001 px
/// (OpenCV adds the windows up in floats, here sums are exact).
///
/// Gradients are computed for the windows only, so few points cost little.
/// Thread safe on different slices of the points. Allocates nothing.
/// @param previous_pyramid,next_pyramid  layout.bytes each.
/// @param previous  points in the first image [px].
/// @param[in,out] next  guesses of the positions in the second image (without a better guess: the same points);
/// replaced
///                      by the positions found (for lost points: the last estimate).
/// @param[out] status  1: tracked, 0: lost (out of the image, no texture, or not a number).
/// @param[out] residual  mean absolute difference of the windows [grey levels]; 0 for lost points.
/// @param begin,end  points to track.
void trackPoints(const uint8_t* previous_pyramid, const uint8_t* next_pyramid, const TrackOptions& options,
                 const Point2f* previous, Point2f* next, uint8_t* status, float* residual, size_t begin, size_t end);

/// track_points: trackPoints() as a task. Range: the points; sliceable. Sums over windows are exact in both
/// implementations. Results are equal where float operations round alike, as on x86-64. Elsewhere they differ by about
/// 0.001 px, and border-line points may differ in their status.
///   0  in     previous pyramid, PyramidLayout(width, height, levels).bytes, as from image_pyramid
///   1  in     next pyramid, likewise
///   2  in     previous points, Point2f[range]
///   3  inout  next points, Point2f[range]: guesses, then results
///   4  out    status, uint8_t[range]
///   5  out    residual, float[range]
///   6         TrackOptions
CodeletPtr trackPointsCodelet();

}  // namespace pi_runtime::kernels
