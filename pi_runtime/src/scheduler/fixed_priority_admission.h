#pragma once

#include <string>
#include <vector>

#include "scheduler/edf_admission.h"

namespace pi_runtime
{

struct FixedPriorityVerdict
{
  bool feasible = false;
  std::vector<double> response_s;  ///< longest response time of each load; infinite if the unit is overloaded
  /// Longest time for which other work of the ordinary class may keep a load of that class from running [s].
  double blocking_budget_s = 0.0;
  double longest_realtime_s = 0.0;  ///< for which loads with a real-time priority can keep all others from running
};

/// Fixed priorities on one unit: response-time analysis (Joseph and Pandya 1986; for deadlines beyond the period by
/// busy periods, Lehoczky 1990, Tindell, Burns, Wellings 1994). Loads of PeriodicLoad::priority above 0 interrupt all
/// with a lower one. Those of equal priority are served in any order, so each counts as disturbed by all others of its
/// level; that covers jobs of the level which do not interrupt each other. Priority 0 is the ordinary class: its loads
/// do not interrupt each other, and run behind all real-time loads.
FixedPriorityVerdict analyseFixedPriority(const std::vector<PeriodicLoad>& loads);

/// The level of a stream's jobs by its deadline, the earliest highest (deadline monotonic), as a SCHED_FIFO priority in
/// [LOWEST_PRIORITY, HIGHEST_PRIORITY]: below the kernel's own threads, which have 50 and more.
constexpr int LOWEST_PRIORITY = 10;
constexpr int HIGHEST_PRIORITY = 15;
/// Of what watches the lanes, and of what feeds them.
constexpr int ABOVE_LANES = HIGHEST_PRIORITY + 1;
int priorityOf(double deadline_s);

}  // namespace pi_runtime
