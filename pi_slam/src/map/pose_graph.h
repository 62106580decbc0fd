#pragma once

#include "map/map_data.h"

namespace pi_slam::map
{

/// Moves nodes so that they fit the edges best: position and heading of each, roll and pitch as measured (4 degrees of
/// freedom, as Qin, Li and Shen, TRO 2018, VIII). Loops count robustly (Huber first, so that large corrections get
/// through, then Cauchy). The first node of each connected part stays where it is.
/// Fixes of GNSS count as well, robustly (Cauchy), once the place on earth is known: nodes and that place move so that
/// both fit.
/// @return false if there is no usable solution; nothing was changed then.
bool optimizePoseGraph(MapData* map);

/// Where map lies on earth: as it was known, or by the fixes. nullopt: they do not tell it yet.
std::optional<EarthPlace> locateOnEarth(const MapData& map);

}  // namespace pi_slam::map
