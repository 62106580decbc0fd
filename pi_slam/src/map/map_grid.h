#pragma once

#include <cstddef>
#include <optional>

#include "map/map_data.h"

namespace pi_slam::map
{

/// The part of a grid within `reach_m` of a point along each axis.
OccupancyCells cutOut(const OccupancyCells& grid, const Eigen::Vector2d& middle, double reach_m);

/// The node by which a patch stands in map; nullptr: none of its segment is left.
const MapNode* nodeOf(const MapData& map, const GridPatch& patch);

/// Appends a patch. Earlier ones of the same place, seen in about the same direction, go.
void addPatch(MapData* map, GridPatch patch);

/// All patches in map. Where they overlap, the latest one that knows a cell counts.
/// @param newest  beyond those of the map; may be nullptr.
/// @return nullopt if there are none, or they would fill more than MOST_CELLS.
std::optional<OccupancyCells> composeGrid(const MapData& map, const GridPatch* newest);

constexpr size_t MOST_CELLS = 100000000;  ///< 1 km x 1 km at 10 cm, 100 MB

}  // namespace pi_slam::map
