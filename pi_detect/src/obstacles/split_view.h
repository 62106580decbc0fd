#pragma once

#include <optional>
#include <vector>

#include "obstacles/measure_outline.h"

namespace pi_detect::obstacles
{

/// Where a surface is split.
struct ViewSplit
{
  int column = 0;             ///< of cells: those before it are the left piece
  bool left_goes_on = false;  ///< behind the right piece, or joined to it
  bool right_goes_on = false;
};

/// Where to split a surface whose convex hull covers free ground: where a post stands before a wall, or in the corner
/// of two walls. Nothing if the free ground is not deeper than the error of depth.
std::optional<ViewSplit> splitView(const std::vector<SurfacePoint>& part, const OutlineScale& scale);

}  // namespace pi_detect::obstacles
