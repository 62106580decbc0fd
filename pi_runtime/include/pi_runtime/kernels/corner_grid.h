#pragma once

#include <cstddef>
#include <vector>

#include <pi_runtime/kernels/fast_corners.h>
#include <pi_runtime/kernels/point.h>

namespace pi_runtime::kernels
{

/// How to spread corners over an image.
struct CornerGrid
{
  int width = 640;             ///< of the image [px]
  int height = 480;            ///< [px]
  int cell = 40;               ///< side of the grid's cells [px]
  int per_cell = 1;            ///< most points in one cell
  float min_distance = 15.0f;  ///< between any two points [px]
  size_t max_points = 300;     ///< in the whole image

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Corners spread evenly over the image: the strongest of each cell first, then the second strongest of each, and so
/// on, as far as there is room; of the same rank the stronger first (ties: the order in the list). Points that are
/// there already take up room, but are not moved.
/// @param corners  `count` ones inside the image, in any order.
/// @param existing  points that corners keep away from, as those of features being tracked; those outside of the image
///                  count as if they were in the nearest cell.
/// @return the corners chosen: at most max_points - existing.size(), in the order of choice.
/// @throws std::invalid_argument if the grid is not valid, or a corner lies outside of the image.
std::vector<Corner> selectGridCorners(const Corner* corners, size_t count, const CornerGrid& grid,
                                      const std::vector<Point2f>& existing = {});

}  // namespace pi_runtime::kernels
