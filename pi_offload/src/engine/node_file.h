#pragma once

#include "engine/node.h"

#include <string>
#include <vector>

namespace pi_offload
{

/// Reads the nodes of a map file, as config/edge_nodes.yaml shows: a list `nodes` of maps with id, address, x, y [m],
/// range [m] (left out: everywhere) and frequency_ghz.
/// @throws std::runtime_error naming file, node, key, value and bound.
std::vector<NodeDescription> loadNodeFile(const std::string& path);

/// @throws std::invalid_argument naming an id that comes twice.
void requireUniqueIds(const std::vector<NodeDescription>& nodes);

}  // namespace pi_offload
