#include "scheduler/edf_admission.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_runtime
{
namespace
{

constexpr double MAX_UTILISATION = 0.999;
/// More deadlines than any sensible set has before the demand falls behind for good.
constexpr size_t MAX_POINTS = 200000;

double demand(const std::vector<PeriodicLoad>& loads, double t)
{
  double sum = 0.0;
  for (const PeriodicLoad& load : loads)
  {
    // Deadlines are sums of periods: compare with a tolerance, or a job at the very end of the interval is missed.
    const double jobs = std::floor((t - load.deadline_s) / load.period_s + 1e-9) + 1.0;
    sum += std::max(0.0, jobs) * load.wcet_s;
  }
  return sum;
}

double laterChunk(const std::vector<PeriodicLoad>& loads, double t)
{
  double longest = 0.0;
  for (const PeriodicLoad& load : loads)
  {
    if (load.deadline_s > t * (1.0 + 1e-9))
    {
      longest = std::max(longest, load.chunk_s);
    }
  }
  return longest;
}

/// The first deadline of any job after t.
double nextDeadline(const std::vector<PeriodicLoad>& loads, double t)
{
  double next = std::numeric_limits<double>::infinity();
  for (const PeriodicLoad& load : loads)
  {
    const double jobs = std::max(0.0, std::floor((t - load.deadline_s) / load.period_s + 1e-9) + 1.0);
    next = std::min(next, load.deadline_s + jobs * load.period_s);
  }
  return next;
}

}  // namespace

EdfVerdict analyseEdf(const std::vector<PeriodicLoad>& loads)
{
  EdfVerdict verdict;
  if (loads.empty())
  {
    verdict.feasible = true;
    verdict.blocking_budget_s = std::numeric_limits<double>::infinity();
    return verdict;
  }
  double utilisation = 0.0;
  double excess = 0.0;  // demand(t) <= utilisation * t + excess
  double longest_deadline = 0.0;
  for (const PeriodicLoad& load : loads)
  {
    utilisation += load.wcet_s / load.period_s;
    excess += std::max(0.0, load.period_s - load.deadline_s) * load.wcet_s / load.period_s;
    longest_deadline = std::max(longest_deadline, load.deadline_s);
  }
  if (utilisation > MAX_UTILISATION)
  {
    return verdict;
  }
  double slack = std::numeric_limits<double>::infinity();
  double t = 0.0;
  for (size_t point = 0; point < MAX_POINTS; ++point)
  {
    t = nextDeadline(loads, t);
    const double left = t - demand(loads, t);
    if (left < laterChunk(loads, t) - 1e-12)
    {
      return verdict;
    }
    slack = std::min(slack, left);
    // From here on the demand leaves more than that, and no load has a later first deadline.
    if (t >= longest_deadline && (1.0 - utilisation) * t - excess >= slack)
    {
      verdict.feasible = true;
      verdict.blocking_budget_s = slack;
      return verdict;
    }
  }
  return verdict;
}

}  // namespace pi_runtime
