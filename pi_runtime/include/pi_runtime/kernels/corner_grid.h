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

/// Spreads corners evenly over the image: first the strongest corner of each cell, then the second strongest, and so on
/// while there is room. Within a rank the stronger corner goes first (ties: by the order in the list). Existing points
/// take up room.
/// @param corners  `count` corners inside the image, in any order.
/// @param existing  points that corners keep their distance from, for example tracked features; points outside of the
///                  image count for the nearest cell.
/// @return the corners chosen: at most max_points - existing.size(), in the order of choice.
/// @throws std::invalid_argument if the grid is not valid, or a corner lies outside of the image.
std::vector<Corner> selectGridCorners(const Corner* corners, size_t count, const CornerGrid& grid,
                                      const std::vector<Point2f>& existing = {});

}  // namespace pi_runtime::kernels
