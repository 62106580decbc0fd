#pragma once

#include <optional>
#include <vector>

#include "simulation/edge_node.h"

namespace pi_offload::simulation
{

/// A task on its way to a node.
struct PendingArrival
{
  int64_t at_ns = 0;
  Arrival arrival;
};

/// When the node would end a task, if only the pending tasks and those of others arrive.
/// @param pending   in any order
/// @param mine      the task; must not arrive before the node's time
/// @return nullopt if the task is refused, dropped, or not done by limit_ns
std::optional<int64_t> foreseeEnd(const EdgeNode& node, std::vector<PendingArrival> pending, const PendingArrival& mine,
                                  int64_t limit_ns);

}  // namespace pi_offload::simulation
