#pragma once

#include "graph/graph_reader.h"

#include <nlohmann/json.hpp>

namespace pi_web
{

/// What a client that watches the graph is told; null if nothing changed.
nlohmann::json graphUpdate(const GraphState& before, const GraphState& now);

/// [{"transport", "links", "topics": [...]}], the most links first.
std::string linksJson(const std::map<std::string, Links>& links);

}  // namespace pi_web
