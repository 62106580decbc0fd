#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace pi_runtime
{

constexpr double INF = std::numeric_limits<double>::infinity();  ///< time: cannot run there; budget: no limit

struct InterCoreMapping;

/// What the inter-core policies work on: tasks that at least one unit can run, and the objective divided by alpha,
/// which is the largest load plus the sum of the costs.
struct InterCoreProblem
{
  size_t tasks = 0;
  size_t units = 0;
  std::vector<double> time;       ///< tasks x units, row-major; +infinity: cannot run there
  std::vector<double> cost;       ///< gamma / alpha * energy, same shape, 0 where time is infinite; empty: no energy
  std::vector<double> available;  ///< per unit
  bool integral = false;          ///< all finite times and available are whole numbers and there are no costs

  const double* timeRow(size_t task) const { return time.data() + task * units; }
  /// nullptr if there are no costs.
  const double* costRow(size_t task) const { return cost.empty() ? nullptr : cost.data() + task * units; }

  /// Time plus cost.
  double weight(size_t task, size_t unit) const
  {
    const size_t entry = task * units + unit;
    return cost.empty() ? time[entry] : time[entry] + cost[entry];
  }

  double objective(const InterCoreMapping& mapping) const;

  /// The largest objective that is still better than `objective`.
  double nextBetter(double objective) const
  {
    constexpr double RELATIVE_STEP = 1e-9;  // well above the rounding of sums of loads
    return integral ? objective - 1.0 : objective * (1.0 - RELATIVE_STEP);
  }
};

/// Tasks of an InterCoreProblem on its units.
struct InterCoreMapping
{
  std::vector<uint32_t> unit;   ///< per task
  std::vector<uint32_t> order;  ///< tasks as they were mapped
  std::vector<double> load;     ///< per unit, available time included

  /// Nothing is mapped yet.
  void start(const InterCoreProblem& problem)
  {
    unit.resize(problem.tasks);
    order.clear();
    order.reserve(problem.tasks);
    load = problem.available;
  }

  void map(const InterCoreProblem& problem, uint32_t task, uint32_t to)
  {
    unit[task] = to;
    order.push_back(task);
    load[to] += problem.timeRow(task)[to];
  }
};

inline double InterCoreProblem::objective(const InterCoreMapping& mapping) const
{
  double result = *std::max_element(mapping.load.begin(), mapping.load.end());
  for (size_t i = 0; i < (cost.empty() ? 0 : tasks); ++i)
  {
    result += costRow(i)[mapping.unit[i]];
  }
  return result;
}

/// Random numbers of splitmix64 (Steele, Lea and Flood 2014): one addition and a mix, any seed is good.
class SplitMix64
{
public:
  explicit SplitMix64(uint64_t seed = 0) : state_(seed) {}

  uint64_t next()
  {
    uint64_t z = (state_ += 0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }

  /// Uniform in [0, bound) but for a bias below bound / 2^32.
  uint32_t below(uint32_t bound) { return static_cast<uint32_t>(((next() >> 32) * bound) >> 32); }

private:
  uint64_t state_;
};

}  // namespace pi_runtime
