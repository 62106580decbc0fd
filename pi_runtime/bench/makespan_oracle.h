#pragma once

#include <pi_runtime/etc_matrix.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pi_runtime_bench
{

struct OracleResult
{
  double makespan = 0.0;       ///< of the best mapping found
  std::vector<uint32_t> unit;  ///< that mapping, per task
  bool proven = false;         ///< no mapping has a smaller makespan (for times that are not whole: by more than 1e-9)
  uint64_t nodes = 0;          ///< of the search tree
};

/// Finds the smallest makespan of independent tasks on unrelated units, the problem R || Cmax, by branch and bound, to
/// measure the scheduler's policies against. A node fixes the units of some tasks; its bound is the dual of the linear
/// relaxation (see src/dual_bound.h, this is an implementation of its own), whose prices are improved from node to
/// node. Pairs of task and unit that the bound rules out are dropped, which mostly decides further tasks. Times need
/// not be whole numbers, but whole ones are proven much faster.
class MakespanOracle
{
public:
  /// @param etc       at most 32 units; every task has a finite entry.
  /// @param incumbent a mapping to start from, per task; a good one saves most of the work. Empty: all tasks on their
  ///                  fastest units.
  /// @param max_nodes after these it gives up, with `proven` false.
  OracleResult solve(const pi_runtime::EtcMatrix& etc, const std::vector<uint32_t>& incumbent, uint64_t max_nodes);

private:
  /// A partial mapping. Tasks whose units are decided are no longer free.
  struct Node
  {
    std::vector<double> load;       ///< per unit, of the decided tasks
    std::vector<double> price;      ///< per unit, sum 1
    std::vector<uint32_t> free;     ///< undecided tasks
    std::vector<uint32_t> allowed;  ///< per free task: bits of the units it may use
  };
  enum class Verdict
  {
    PRUNED,
    CHANGED,
    STABLE,
  };

  void accept(const std::vector<uint32_t>& unit);
  void explore(size_t depth);
  /// Drops the pairs that the loads rule out and decides the tasks that have one unit left.
  Verdict decideForced(Node* node);
  /// Evaluates the bound, tries the mapping that minimises it, and drops the pairs that it rules out.
  Verdict tighten(Node* node);
  void updatePrices(Node* node, double rate);
  static bool allows(const Node& node, size_t f, uint32_t unit) { return (node.allowed[f] >> unit & 1U) != 0; }

  const pi_runtime::EtcMatrix* etc_ = nullptr;
  uint64_t max_nodes_ = 0;
  bool whole_ = false;
  double target_ = 0.0;               ///< only mappings of at most this makespan are of interest
  std::vector<uint32_t> unit_;        ///< of the decided tasks on the way to the current node
  std::vector<Node> nodes_;           ///< by depth
  std::vector<double> relaxed_load_;  ///< of the mapping that minimises the dual bound of the current node
  std::vector<double> smallest_;      ///< per free task: its smallest entry of the bound
  OracleResult result_;
};

}  // namespace pi_runtime_bench
