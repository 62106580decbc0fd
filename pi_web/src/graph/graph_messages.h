#pragma once

#include "graph/graph_reader.h"

#include <nlohmann/json.hpp>

namespace pi_web
{

/// What a client that watches the graph is told; null if nothing changed.
nlohmann::json graphUpdate(const GraphState& before, const GraphState& now);

}  // namespace pi_web
