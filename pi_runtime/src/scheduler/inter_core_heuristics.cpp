#include "scheduler/inter_core_heuristics.h"

#include <algorithm>
#include <tuple>

namespace pi_runtime
{
namespace
{

/// Bounds the quadratic policies; far above the metatasks of a vehicle, so that they are exact there.
constexpr size_t DYNAMIC_RANK_WINDOW = 1024;

uint32_t unitOfSmallestCompletion(const InterCoreProblem& problem, uint32_t task, const std::vector<double>& load)
{
  double best = INF;
  uint32_t unit = 0;
  for (uint32_t j = 0; j < problem.units; ++j)
  {
    const double completion = load[j] + problem.weight(task, j);
    if (completion < best)
    {
      best = completion;
      unit = j;
    }
  }
  return unit;
}

}  // namespace

void InterCoreHeuristics::diffMin(const InterCoreProblem& problem, DiffMinOrder order, uint64_t seed,
                                  InterCoreMapping* mapping)
{
  SplitMix64 random(seed);
  keys_.resize(problem.tasks);
  for (uint32_t i = 0; i < problem.tasks; ++i)  // steps (1) and (2)
  {
    const double* row = problem.timeRow(i);
    uint32_t infeasible_units = 0;
    double smallest = INF;
    double largest = 0.0;
    for (size_t j = 0; j < problem.units; ++j)
    {
      const bool feasible = row[j] < INF;
      infeasible_units += feasible ? 0 : 1;
      smallest = std::min(smallest, row[j]);
      largest = feasible ? std::max(largest, row[j]) : largest;
    }
    keys_[i] = {i, infeasible_units, largest / smallest, largest - smallest, random.next()};
  }
  // Steps (5) and (6); the keys do not change, so one sort replaces the repeated choice.
  const auto later = [order](const DiffMinKey& key)
  {
    const double direction = order == DiffMinOrder::MAX_DIV ? -1.0 : 1.0;
    return std::tuple(direction * key.infeasible_units, direction * key.div, -key.sub, key.draw);
  };
  std::sort(keys_.begin(), keys_.end(),
            [&later](const DiffMinKey& a, const DiffMinKey& b) { return later(a) < later(b); });
  mapping->start(problem);  // step (3)
  for (const DiffMinKey& key : keys_)
  {
    mapping->map(problem, key.task, unitOfSmallestCompletion(problem, key.task, mapping->load));  // steps (7) and (8)
  }
}

void InterCoreHeuristics::minMin(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  columns_.clear();
  heads_.resize(problem.units);
  ends_.resize(problem.units);
  for (uint32_t j = 0; j < problem.units; ++j)
  {
    heads_[j] = columns_.size();
    for (uint32_t i = 0; i < problem.tasks; ++i)
    {
      const double weight = problem.weight(i, j);
      if (weight < INF)
      {
        columns_.emplace_back(weight, i);
      }
    }
    ends_[j] = columns_.size();
    std::sort(columns_.begin() + static_cast<std::ptrdiff_t>(heads_[j]), columns_.end());
  }
  mapped_.assign(problem.tasks, false);
  mapping->start(problem);
  for (size_t count = 0; count < problem.tasks; ++count)
  {
    std::pair<double, uint32_t> best(INF, 0);  // completion and task
    uint32_t unit = 0;
    for (uint32_t j = 0; j < problem.units; ++j)
    {
      while (heads_[j] < ends_[j] && mapped_[columns_[heads_[j]].second])
      {
        ++heads_[j];
      }
      if (heads_[j] == ends_[j])
      {
        continue;
      }
      const auto& [weight, task] = columns_[heads_[j]];
      const std::pair<double, uint32_t> candidate(mapping->load[j] + weight, task);
      if (candidate < best)
      {
        best = candidate;
        unit = j;
      }
    }
    mapped_[best.second] = true;
    mapping->map(problem, best.second, unit);
  }
}

InterCoreHeuristics::Prospect InterCoreHeuristics::prospect(const InterCoreProblem& problem, uint32_t task,
                                                            const std::vector<double>& load)
{
  Prospect result{task, 0, 0, INF, INF};
  for (uint32_t j = 0; j < problem.units; ++j)
  {
    const double completion = load[j] + problem.weight(task, j);
    if (completion < result.completion)
    {
      result.second_unit = result.unit;
      result.second_completion = result.completion;
      result.unit = j;
      result.completion = completion;
    }
    else if (completion < result.second_completion)
    {
      result.second_unit = j;
      result.second_completion = completion;
    }
  }
  return result;
}

double InterCoreHeuristics::rank(const Prospect& prospect, DynamicRank by)
{
  return by == DynamicRank::COMPLETION ? prospect.completion : prospect.second_completion - prospect.completion;
}

bool InterCoreHeuristics::mapByDynamicRank(const InterCoreProblem& problem, DynamicRank by, const DualBound* bound,
                                           double objective, InterCoreMapping* mapping)
{
  constexpr double ROUNDING = 1e-9;  // above that of the sum of the reduced costs
  double least = bound != nullptr ? bound->relaxedValue() * (1.0 - ROUNDING) : 0.0;
  mapping->start(problem);
  ranked_.clear();
  for (uint32_t i = 0; i < problem.tasks; ++i)
  {
    ranked_.emplace_back(rank(prospect(problem, i, mapping->load), by), i);
  }
  if (problem.tasks > DYNAMIC_RANK_WINDOW)
  {
    sortRanked();
  }
  window_.clear();
  size_t next = 0;
  for (size_t count = 0; count < problem.tasks; ++count)
  {
    while (next < problem.tasks && window_.size() < DYNAMIC_RANK_WINDOW)
    {
      window_.push_back(prospect(problem, ranked_[next++].second, mapping->load));
    }
    const auto first = std::max_element(window_.begin(), window_.end(),
                                        [by](const Prospect& a, const Prospect& b)
                                        {
                                          const double rank_a = rank(a, by);
                                          const double rank_b = rank(b, by);
                                          return rank_a < rank_b || (rank_a == rank_b && a.task > b.task);
                                        });
    const uint32_t unit = first->unit;
    mapping->map(problem, first->task, unit);
    if (bound != nullptr && (least += bound->reducedCost(problem, first->task, unit)) >= objective)
    {
      return false;
    }
    *first = window_.back();
    window_.pop_back();
    for (Prospect& waiting : window_)
    {
      if (waiting.unit == unit || waiting.second_unit == unit)  // no other completion has changed
      {
        waiting = prospect(problem, waiting.task, mapping->load);
      }
    }
  }
  return true;
}

void InterCoreHeuristics::maxMin(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  mapByDynamicRank(problem, DynamicRank::COMPLETION, nullptr, INF, mapping);
}

void InterCoreHeuristics::sufferage(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  mapByDynamicRank(problem, DynamicRank::SUFFERAGE, nullptr, INF, mapping);
}

bool InterCoreHeuristics::sufferageBelow(const InterCoreProblem& problem, const DualBound& bound, double objective,
                                         InterCoreMapping* mapping)
{
  return mapByDynamicRank(problem, DynamicRank::SUFFERAGE, &bound, objective, mapping);
}

void InterCoreHeuristics::mct(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  mapping->start(problem);
  for (uint32_t i = 0; i < problem.tasks; ++i)
  {
    mapping->map(problem, i, unitOfSmallestCompletion(problem, i, mapping->load));
  }
}

void InterCoreHeuristics::met(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  mapping->start(problem);
  for (uint32_t i = 0; i < problem.tasks; ++i)
  {
    uint32_t unit = 0;
    for (uint32_t j = 1; j < problem.units; ++j)
    {
      unit = problem.weight(i, j) < problem.weight(i, unit) ? j : unit;
    }
    mapping->map(problem, i, unit);
  }
}

void InterCoreHeuristics::olb(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  mapping->start(problem);
  for (uint32_t i = 0; i < problem.tasks; ++i)
  {
    const double* time = problem.timeRow(i);
    const double* cost = problem.costRow(i);
    double best = INF;
    uint32_t unit = 0;
    for (uint32_t j = 0; j < problem.units; ++j)
    {
      const double key = mapping->load[j] + (cost != nullptr ? cost[j] : 0.0);
      if (time[j] < INF && key < best)
      {
        best = key;
        unit = j;
      }
    }
    mapping->map(problem, i, unit);
  }
}

void InterCoreHeuristics::sortRanked()
{
  std::sort(ranked_.begin(), ranked_.end(),
            [](const auto& a, const auto& b)
            { return a.first > b.first || (a.first == b.first && a.second < b.second); });
}

void InterCoreHeuristics::mapRanked(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  mapping->start(problem);
  for (const auto& [rank, task] : ranked_)
  {
    mapping->map(problem, task, unitOfSmallestCompletion(problem, task, mapping->load));
  }
}

void InterCoreHeuristics::heftRank(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  ranked_.clear();
  for (uint32_t i = 0; i < problem.tasks; ++i)
  {
    const double* row = problem.timeRow(i);
    double sum = 0.0;
    size_t feasible_units = 0;
    for (size_t j = 0; j < problem.units; ++j)
    {
      if (row[j] < INF)
      {
        sum += row[j];
        ++feasible_units;
      }
    }
    ranked_.emplace_back(sum / static_cast<double>(feasible_units), i);
  }
  sortRanked();
  mapRanked(problem, mapping);
}

void InterCoreHeuristics::longestFirst(const InterCoreProblem& problem, InterCoreMapping* mapping)
{
  ranked_.clear();
  for (uint32_t i = 0; i < problem.tasks; ++i)
  {
    double smallest = INF;
    for (size_t j = 0; j < problem.units; ++j)
    {
      smallest = std::min(smallest, problem.weight(i, j));
    }
    ranked_.emplace_back(smallest, i);
  }
  sortRanked();
  mapRanked(problem, mapping);
}

}  // namespace pi_runtime
