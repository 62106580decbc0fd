#pragma once

#include "scheduler/inter_core_problem.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pi_runtime
{

/// Lower bound of the objective of an InterCoreProblem from its linear relaxation. For every price vector p >= 0 with
/// sum 1,
///   L(p) = sum_j p_j available_j + sum_i min_j (p_j time_ij + cost_ij) <= max load + sum of costs
/// of every mapping, as the largest load is at least the mean of the loads weighted by p. The best p is approached by
/// multiplicative price updates: units that the minimising mapping overloads become dearer.
class DualBound
{
public:
  /// Sets equal prices.
  void start(const InterCoreProblem& problem);

  /// Evaluates L(p) and updates the prices. Call repeatedly: after 40 calls the bound is within 0.1 % of the linear
  /// relaxation for 50 tasks on 6 units, within 1 % for 10 tasks. O(tasks * units), allocates nothing.
  void improve(const InterCoreProblem& problem);

  /// Best L(p) so far, at least the trivial bounds (each task alone, the available times), rounded up for a problem of
  /// whole numbers.
  double value() const { return value_; }
  /// Maps every task to the unit of the smallest entry of the best L(p). Valid after improve().
  void minimisingMapping(const InterCoreProblem& problem, std::vector<uint32_t>* unit) const;
  /// The best L(p) itself, neither rounded nor raised by the trivial bounds. Valid after improve().
  double relaxedValue() const { return relaxed_value_; }
  /// Of the best L(p).
  double price(size_t unit) const { return best_prices_[unit]; }
  /// relaxedValue() of the problem in which the task must run on the unit is higher by at least this: its entry of L(p)
  /// less the smallest of its row. Valid after improve().
  double reducedCost(const InterCoreProblem& problem, size_t task, size_t unit) const
  {
    return entry(problem, best_prices_, task, unit) - best_row_minimum_[task];
  }

private:
  static double entry(const InterCoreProblem& problem, const std::vector<double>& prices, size_t task, size_t unit)
  {
    const double* cost = problem.costRow(task);
    return prices[unit] * problem.timeRow(task)[unit] + (cost != nullptr ? cost[unit] : 0.0);
  }
  double evaluate(const InterCoreProblem& problem);

  std::vector<double> prices_;
  std::vector<double> best_prices_;
  std::vector<double> row_minimum_;       ///< min_j (p_j time_ij + cost_ij) at prices_
  std::vector<double> best_row_minimum_;  ///< at best_prices_
  std::vector<double> load_;              ///< of the minimising mapping
  double value_ = 0.0;
  double relaxed_value_ = 0.0;
  int steps_ = 0;
};

}  // namespace pi_runtime
