#pragma once

#include <optional>
#include <vector>

#include "obstacles/measure_outline.h"
#include "obstacles/surface_point.h"

namespace pi_detect::obstacles
{

/// Where a part of a surface is to be taken apart.
struct ViewSplit
{
  int column = 0;             ///< of cells: those before it are the left piece
  bool left_goes_on = false;  ///< behind the right piece, or joined to it
  bool right_goes_on = false;
};

/// The convex hull of a part covers ground over which the camera looks at the rest of it: where a post stands before a
/// wall, or in the corner of two walls. Nothing if that is nowhere deeper than the depth's errors allow to tell.
std::optional<ViewSplit> splitView(const std::vector<SurfacePoint>& part, const OutlineScale& scale);

}  // namespace pi_detect::obstacles
