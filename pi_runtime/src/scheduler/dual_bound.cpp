#include "scheduler/dual_bound.h"

#include <algorithm>
#include <cmath>

namespace pi_runtime
{
namespace
{

double trivialBound(const InterCoreProblem& problem)
{
  double sum_of_costs = 0.0;
  double excess = *std::max_element(problem.available.begin(), problem.available.end());
  for (size_t i = 0; i < problem.tasks; ++i)
  {
    const double* cost = problem.costRow(i);
    double cheapest = INF;
    double completion = INF;
    for (size_t j = 0; j < problem.units; ++j)
    {
      const double time = problem.timeRow(i)[j];
      if (time < INF)
      {
        cheapest = std::min(cheapest, cost != nullptr ? cost[j] : 0.0);
        completion = std::min(completion, problem.available[j] + problem.weight(i, j));
      }
    }
    sum_of_costs += cheapest;
    excess = std::max(excess, completion - cheapest);
  }
  return sum_of_costs + excess;
}

}  // namespace

void DualBound::start(const InterCoreProblem& problem)
{
  prices_.assign(problem.units, 1.0 / static_cast<double>(problem.units));
  best_prices_ = prices_;
  row_minimum_.resize(problem.tasks);
  best_row_minimum_.resize(problem.tasks);
  load_.resize(problem.units);
  value_ = trivialBound(problem);
  relaxed_value_ = -INF;
  steps_ = 0;
}

double DualBound::evaluate(const InterCoreProblem& problem)
{
  load_ = problem.available;
  double value = 0.0;
  for (size_t j = 0; j < problem.units; ++j)
  {
    value += prices_[j] * problem.available[j];
  }
  for (size_t i = 0; i < problem.tasks; ++i)
  {
    double smallest = INF;
    size_t unit = 0;
    for (size_t j = 0; j < problem.units; ++j)
    {
      const double candidate = entry(problem, prices_, i, j);
      if (candidate < smallest)
      {
        smallest = candidate;
        unit = j;
      }
    }
    row_minimum_[i] = smallest;
    load_[unit] += problem.timeRow(i)[unit];
    value += smallest;
  }
  return value;
}

void DualBound::improve(const InterCoreProblem& problem)
{
  constexpr double FIRST_STEP = 0.3;  // relative change of a price; this and the decay measured on the paper's grid
  constexpr double DECAY = 0.06;
  constexpr double LEAST_PRICE = 1e-12;  // of a unit that no task needs; keeps price * infinity infinite
  constexpr double ROUNDING = 1e-10;     // above that of the sum of 10^5 products

  const double value = evaluate(problem);
  if (value > relaxed_value_)
  {
    relaxed_value_ = value;
    best_prices_ = prices_;
    best_row_minimum_ = row_minimum_;
    const double certain = value * (1.0 - ROUNDING);
    value_ = std::max(value_, problem.integral ? std::ceil(certain - ROUNDING) : certain);
  }
  double mean_load = 0.0;
  for (size_t j = 0; j < problem.units; ++j)
  {
    mean_load += prices_[j] * load_[j];
  }
  const double rate = FIRST_STEP / (1.0 + DECAY * steps_++);
  double sum = 0.0;
  for (size_t j = 0; j < problem.units; ++j)
  {
    const double overload = std::clamp(load_[j] / mean_load - 1.0, -1.0, 1.0);
    prices_[j] = std::max(prices_[j] * std::exp(rate * overload), LEAST_PRICE);
    sum += prices_[j];
  }
  for (double& price : prices_)
  {
    price /= sum;
  }
}

void DualBound::minimisingMapping(const InterCoreProblem& problem, std::vector<uint32_t>* unit) const
{
  unit->resize(problem.tasks);
  for (size_t i = 0; i < problem.tasks; ++i)
  {
    uint32_t best = 0;
    for (uint32_t j = 1; j < problem.units; ++j)
    {
      best = entry(problem, best_prices_, i, j) < entry(problem, best_prices_, i, best) ? j : best;
    }
    (*unit)[i] = best;
  }
}

}  // namespace pi_runtime
