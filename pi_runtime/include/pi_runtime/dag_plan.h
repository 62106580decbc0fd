#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/task_graph.h>
#include <pi_runtime/transfer_model.h>

namespace pi_runtime
{

/// Earliest starts. All times of a plan count from the same instant as these. An empty vector: all 0.
struct StartTimes
{
  std::vector<double> available;  ///< per unit: end of its earlier work [s], finite and >= 0
  std::vector<double> release;    ///< per node: arrival of its data from outside [s], finite and >= 0
};

/// Which unit runs each node of a graph, and when.
struct DagPlan
{
  static constexpr uint32_t NO_UNIT = std::numeric_limits<uint32_t>::max();

  std::vector<uint32_t> unit;                ///< per node
  std::vector<double> start;                 ///< per node [s]
  std::vector<double> finish;                ///< per node [s]
  std::vector<uint32_t> level;               ///< per node, as TaskGraph::level()
  std::vector<double> rank;                  ///< per node: upward rank, the mean time from its start to the end [s]
  std::vector<std::vector<uint32_t>> order;  ///< per unit: its nodes, first to start first
  double makespan = 0.0;                     ///< latest finish [s]
  double critical_path = 0.0;                ///< longest chain, each node on its fastest unit, without transfers [s]

  /// Nodes that no unit can run. If there are any, nothing is planned: every unit is NO_UNIT, every time 0.
  std::vector<uint32_t> infeasible;

  bool feasible() const { return infeasible.empty(); }

  /// Schedule length ratio (Topcuoglu, Hariri, Wu 2002, eq. 9): makespan over critical path, >= 1. An upper
  /// bound of the plan's length over that of the best plan. 1 for a graph without work; undefined if not feasible().
  double slr() const { return makespan == critical_path ? 1.0 : makespan / critical_path; }
};

}  // namespace pi_runtime
