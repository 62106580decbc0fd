#pragma once

#include <vector>

namespace pi_runtime
{

/// A periodic task as the admission test sees it.
struct PeriodicLoad
{
  double period_s;    ///< shortest time between two jobs, > 0
  double deadline_s;  ///< after the release of a job, > 0
  double wcet_s;      ///< longest execution time, > 0
  /// Longest stretch in which a job cannot be interrupted: wcet_s, or that of a slice.
  double chunk_s;
};

struct EdfVerdict
{
  bool feasible = false;
  /// Longest uninterrupted stretch that other work may have on the unit without any job being late [s]; infinite
  /// without loads, 0 if not feasible.
  double blocking_budget_s = 0.0;
};

/// Earliest deadline first on one unit that does not interrupt a job (or slice) once begun: processor demand test for
/// sporadic tasks with blocking (Jeffay, Stanat, Martel 1991, extended to deadlines other than periods by George,
/// Rivierre, Spuri 1996): for each interval t the demand of all jobs with release and deadline in it, and one stretch
/// of a job with a later deadline, fit into t.
///
/// Sufficient and, for integer release times, necessary. Conservative where the loads come within 0.1 % of the whole
/// unit: then not feasible.
EdfVerdict analyseEdf(const std::vector<PeriodicLoad>& loads);

}  // namespace pi_runtime
