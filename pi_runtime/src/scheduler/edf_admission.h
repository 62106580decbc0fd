#pragma once

#include <vector>

namespace pi_runtime
{

/// A periodic task in the admission test.
struct PeriodicLoad
{
  double period_s;    ///< shortest time between two jobs, > 0
  double deadline_s;  ///< after the release of a job, > 0
  double wcet_s;      ///< longest execution time, > 0
  /// Longest part of a job that cannot be interrupted: wcet_s, or the length of a slice.
  double chunk_s;
  int priority = 0;  ///< real-time priority of its jobs; 0: none, they do not interrupt others

  bool operator==(const PeriodicLoad& other) const
  {
    return period_s == other.period_s && deadline_s == other.deadline_s && wcet_s == other.wcet_s &&
           chunk_s == other.chunk_s && priority == other.priority;
  }
};

struct EdfVerdict
{
  bool feasible = false;
  /// Longest uninterrupted time for other work on the unit such that no job is late [s]; infinite without loads, 0 if
  /// not feasible.
  double blocking_budget_s = 0.0;
};

/// Earliest deadline first on one unit that does not interrupt a job (or slice) once begun: processor demand test for
/// sporadic tasks with blocking (Jeffay, Stanat, Martel 1991, extended to deadlines other than periods by George,
/// Rivierre, Spuri 1996): for each interval t the demand of all jobs with release and deadline in it, and one stretch
/// of a job with a later deadline, fit into t.
///
/// Sufficient and, for integer release times, necessary. Loads within 0.1 % of the whole unit count as not feasible.
EdfVerdict analyseEdf(const std::vector<PeriodicLoad>& loads);

}  // namespace pi_runtime
