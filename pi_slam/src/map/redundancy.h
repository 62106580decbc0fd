#pragma once

#include <optional>
#include <vector>

#include "map/map_data.h"

namespace pi_slam::map
{

/// The most redundant keyframes of a map with more than `most` of them: those with the nearest neighbour, in units of
/// distance_m and angle_rad. One keyframe in twenty goes at once, so that the search is rare. The newest ones stay.
/// @return indices of nodes; empty if there are not more than `most` keyframes.
std::vector<size_t> redundantKeyframes(const MapData& map, size_t most, double distance_m, double angle_rad);

/// Takes nodes without features out of a map that has more than `most` nodes: of the older half of them every other
/// one. Their edges are combined into edges between the nodes that stay.
/// @return where each node has gone (-1: taken out); nullopt if nothing changed.
std::optional<std::vector<int64_t>> thinOut(MapData* map, size_t most);

/// Edge from a to c, of one from a to b and one from b to c; and the same edge seen from the other end.
MapEdge compose(const MapEdge& first, const MapEdge& second);
MapEdge inverse(const MapEdge& edge);

}  // namespace pi_slam::map
