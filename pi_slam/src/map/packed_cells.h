#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "map/occupancy_cells.h"

namespace pi_slam::map
{

/// A grid that takes little memory until it is looked at: its cells as a PNG. Nothing is lost.
class PackedCells
{
public:
  PackedCells() = default;
  PackedCells(const OccupancyCells& grid);  // NOLINT: a grid may stand wherever it is kept packed

  OccupancyCells unpack() const;
  /// Without its cells.
  const OccupancyCells& frame() const { return frame_; }
  /// Number of cells.
  size_t count() const
  {
    return packed_.empty() ? 0 : static_cast<size_t>(frame_.width) * static_cast<size_t>(frame_.height);
  }
  size_t bytes() const { return sizeof(*this) + packed_.capacity(); }

private:
  OccupancyCells frame_;
  std::vector<uint8_t> packed_;
};

}  // namespace pi_slam::map
