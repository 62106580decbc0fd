#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <pi_runtime/inner_core_scheduler.h>
#include "dag_families.h"
#include "scheduler/inter_core_problem.h"

/// What the tests of the inner-core scheduler share: options, problems, and plans that have been checked.
namespace pi_runtime
{

using pi_runtime_bench::DagProblem;

constexpr double ROUNDING = 1e-9;  // relative; sums of a few dozen numbers taken in another order

InnerCoreOptions with(InnerCorePolicy policy, bool insertion = true);
InnerCoreOptions levels(LevelMapping mapping, bool barrier, bool insertion = true);
std::vector<InnerCoreOptions> allOptions();
std::string name(const InnerCoreOptions& options);

/// Plans with one policy; it is a failure of the test if the plan does not hold.
DagPlan planned(const InnerCoreOptions& options, const DagProblem& problem,
                const StartTimes& start_times = StartTimes());

DagProblem independentTasks(EtcMatrix etc);

/// Each task can run on at least one unit.
EtcMatrix randomTimes(std::size_t tasks, std::size_t units, double infinite_share, std::mt19937_64* random);

/// Graphs of all families, homogeneous and heterogeneous, with CCR 0, 1 and 5 on 2 to 8 units; in each third one some
/// units cannot run some nodes.
std::vector<DagProblem> randomProblems(int per_setting, uint64_t seed);

/// The same with times and transfers rounded to small whole numbers: gaps are filled to the end, and ties are common.
std::vector<DagProblem> roundedProblems(int per_setting, uint64_t seed);

/// Topcuoglu, Hariri, Wu 2002, figure 2 and table 1: ten nodes, three processors.
DagProblem paperExample();

}  // namespace pi_runtime
