#include "scheduler/fixed_priority_admission.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_runtime
{
namespace
{

constexpr double FULL = 0.999;
constexpr double NEVER_S = std::numeric_limits<double>::infinity();
/// Busy periods of this many jobs of one load do not come from sensible sets.
constexpr int MOST_JOBS = 10000;
/// The deadlines of the levels from the highest down [s]: octaves, so that the levels hold what a vehicle has.
constexpr double LEVEL_DEADLINES_S[] = {0.005, 0.010, 0.020, 0.040, 0.080};

/// Jobs of the load in a stretch of this length that begins with one of them.
double jobsIn(const PeriodicLoad& load, double stretch_s)
{
  return std::max(1.0, std::ceil(stretch_s / load.period_s - 1e-9));
}

/// The smallest w with w = own_s + what the loads of at least this priority do in w.
double busyFor(double own_s, const std::vector<PeriodicLoad>& loads, size_t without, int priority)
{
  double w = own_s;
  for (;;)
  {
    double next = own_s;
    for (size_t i = 0; i < loads.size(); ++i)
    {
      if (i != without && loads[i].priority >= priority)
      {
        next += jobsIn(loads[i], w) * loads[i].wcet_s;
      }
    }
    if (next <= w * (1.0 + 1e-12))
    {
      return w;
    }
    w = next;
  }
}

double utilisationFrom(const std::vector<PeriodicLoad>& loads, int priority)
{
  double sum = 0.0;
  for (const PeriodicLoad& load : loads)
  {
    sum += load.priority >= priority ? load.wcet_s / load.period_s : 0.0;
  }
  return sum;
}

double responseOf(size_t index, const std::vector<PeriodicLoad>& loads)
{
  const PeriodicLoad& load = loads[index];
  if (utilisationFrom(loads, load.priority) > FULL)
  {
    return NEVER_S;
  }
  double longest_s = 0.0;
  for (int job = 0; job < MOST_JOBS; ++job)
  {
    const double end_s = busyFor((job + 1) * load.wcet_s, loads, index, load.priority);
    longest_s = std::max(longest_s, end_s - job * load.period_s);
    if (end_s <= (job + 1) * load.period_s * (1.0 + 1e-9))
    {
      return longest_s;
    }
  }
  return NEVER_S;
}

}  // namespace

FixedPriorityVerdict analyseFixedPriority(const std::vector<PeriodicLoad>& loads)
{
  FixedPriorityVerdict verdict;
  verdict.feasible = true;
  verdict.blocking_budget_s = NEVER_S;
  for (size_t i = 0; i < loads.size(); ++i)
  {
    const double response_s = responseOf(i, loads);
    verdict.response_s.push_back(response_s);
    verdict.feasible = verdict.feasible && response_s <= loads[i].deadline_s * (1.0 + 1e-9);
    if (loads[i].priority == 0)
    {
      verdict.blocking_budget_s = std::min(verdict.blocking_budget_s, loads[i].deadline_s - response_s);
    }
  }
  verdict.blocking_budget_s = verdict.feasible ? std::max(verdict.blocking_budget_s, 0.0) : 0.0;
  const bool any = std::any_of(loads.begin(), loads.end(), [](const PeriodicLoad& load) { return load.priority > 0; });
  if (any)
  {
    verdict.longest_realtime_s = utilisationFrom(loads, 1) > FULL ? NEVER_S : busyFor(1e-9, loads, loads.size(), 1);
  }
  return verdict;
}

int priorityOf(double deadline_s)
{
  int priority = HIGHEST_PRIORITY;
  for (const double level_s : LEVEL_DEADLINES_S)
  {
    if (deadline_s <= level_s * (1.0 + 1e-9))
    {
      return priority;
    }
    --priority;
  }
  return priority;
}

}  // namespace pi_runtime
