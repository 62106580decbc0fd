#pragma once

#include "simulation/edge_node.h"

#include <optional>
#include <vector>

namespace pi_offload::simulation
{

/// A task on its way to a node.
struct PendingArrival
{
  int64_t at_ns = 0;
  Arrival arrival;
};

/// When the node would be done with a task, if nothing came to it but what is on its way and what others send.
/// @param pending   on its way, in any order
/// @param mine      arrives at mine.at_ns, not before what the node has seen
/// @param limit_ns  later does not matter
/// @return nothing: refused, dropped, or not done by then
std::optional<int64_t> foreseeEnd(const EdgeNode& node, std::vector<PendingArrival> pending, const PendingArrival& mine,
                                  int64_t limit_ns);

}  // namespace pi_offload::simulation
