#pragma once

#include <string>
#include <vector>

#include "engine/node.h"

namespace pi_offload
{

/// Reads a map file such as config/edge_nodes.yaml: a list `nodes` of maps with id, address, x, y [m], range [m]
/// (default: everywhere) and frequency_ghz.
/// @throws std::runtime_error naming file, node, key, value and bound.
std::vector<NodeDescription> loadNodeFile(const std::string& path);

/// @throws std::invalid_argument naming an id that occurs twice.
void requireUniqueIds(const std::vector<NodeDescription>& nodes);

}  // namespace pi_offload
