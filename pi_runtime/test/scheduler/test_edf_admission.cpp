#include "scheduler/edf_admission.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime
{
namespace
{

PeriodicLoad load(double period, double wcet, double deadline = 0.0, double chunk = 0.0)
{
  return PeriodicLoad{period, deadline > 0.0 ? deadline : period, wcet, chunk > 0.0 ? chunk : wcet};
}

/// Runs random sporadic jobs of the loads by EDF in chunks on one unit, and batch work of `batch_s` at a time whenever
/// no job waits. @return the longest lateness of any job [s], negative if all are early.
double simulate(const std::vector<PeriodicLoad>& loads, double batch_s, std::mt19937& random, double horizon_s)
{
  struct Job
  {
    double deadline;
    double left;
    double chunk;
  };
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const bool packed = random() % 2 == 0;  // as often as allowed, else with random pauses
  std::vector<double> next(loads.size());
  for (double& release : next)
  {
    release = packed && random() % 2 == 0 ? 0.0 : unit(random) * 2.0;
  }
  std::vector<Job> waiting;
  double now = 0.0;
  double lateness = -INF;
  while (now < horizon_s)
  {
    for (size_t i = 0; i < loads.size(); ++i)
    {
      while (next[i] <= now)
      {
        waiting.push_back({next[i] + loads[i].deadline_s, loads[i].wcet_s, loads[i].chunk_s});
        next[i] += loads[i].period_s * (packed ? 1.0 : 1.0 + unit(random));
      }
    }
    if (waiting.empty())
    {
      const double release = *std::min_element(next.begin(), next.end());
      // The worst that batch work can do is to begin just before a job comes.
      now = batch_s > 0.0 ? std::max(now, release - 1e-9) + batch_s : release;
      continue;
    }
    const auto first = std::min_element(waiting.begin(), waiting.end(),
                                        [](const Job& a, const Job& b) { return a.deadline < b.deadline; });
    const double piece = std::min(first->left, first->chunk);
    now += piece;
    first->left -= piece;
    if (first->left < 1e-12)
    {
      lateness = std::max(lateness, now - first->deadline);
      waiting.erase(first);
    }
  }
  return lateness;
}

std::vector<PeriodicLoad> randomSet(std::mt19937& random)
{
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<PeriodicLoad> loads;
  const size_t count = 1 + random() % 5;
  for (size_t i = 0; i < count; ++i)
  {
    const double period = std::pow(10.0, unit(random));
    const double wcet = period * unit(random) * 1.4 / static_cast<double>(count);
    const double deadline = period * (0.3 + 1.2 * unit(random));
    loads.push_back(load(period, wcet, deadline, random() % 2 == 0 ? 0.0 : wcet * (0.1 + 0.9 * unit(random))));
  }
  return loads;
}

TEST(EdfAdmission, WithoutLoadsEverythingIsAllowed)
{
  EXPECT_TRUE(analyseEdf({}).feasible);
  EXPECT_EQ(INF, analyseEdf({}).blocking_budget_s);
}

TEST(EdfAdmission, OneLoadLeavesItsDeadlineLessItsTime)
{
  EXPECT_NEAR(0.008, analyseEdf({load(0.010, 0.002)}).blocking_budget_s, 1e-12);
  EXPECT_NEAR(0.003, analyseEdf({load(0.010, 0.002, 0.005)}).blocking_budget_s, 1e-12);
  EXPECT_NEAR(0.018, analyseEdf({load(0.010, 0.002, 0.020)}).blocking_budget_s, 1e-12);
}

TEST(EdfAdmission, ALoadThatExactlyMeetsItsDeadlineIsFeasible)
{
  const EdfVerdict verdict = analyseEdf({load(0.010, 0.002, 0.002)});
  EXPECT_TRUE(verdict.feasible);
  EXPECT_NEAR(0.0, verdict.blocking_budget_s, 1e-12);
  EXPECT_FALSE(analyseEdf({load(0.010, 0.003, 0.002)}).feasible);
}

TEST(EdfAdmission, ALongPieceOfALaterDeadlineMustFitInFrontOfAnEarlierOne)
{
  EXPECT_TRUE(analyseEdf({load(0.010, 0.004), load(1.0, 0.006)}).feasible);
  EXPECT_FALSE(analyseEdf({load(0.010, 0.004), load(1.0, 0.0061)}).feasible);
  EXPECT_TRUE(analyseEdf({load(0.010, 0.004), load(1.0, 0.1, 1.0, 0.005)}).feasible) << "in slices it fits";
}

TEST(EdfAdmission, TheWholeUnitIsTooMuch)
{
  EXPECT_FALSE(analyseEdf({load(1.0, 0.5), load(1.0, 0.5)}).feasible) << "0.1 % must stay free";
  EXPECT_TRUE(analyseEdf({load(1.0, 0.5), load(1.0, 0.49)}).feasible);
  EXPECT_FALSE(analyseEdf({load(1.0, 1.2)}).feasible);
  EXPECT_EQ(0.0, analyseEdf({load(1.0, 1.2)}).blocking_budget_s);
}

TEST(EdfAdmission, CountsAJobWhoseDeadlineFallsOnTheVeryEndOfAnInterval)
{
  // 0.1 + 0.1 + 0.1 is more than 0.3 in binary; three jobs are due by then all the same, and one of the other load.
  const EdfVerdict verdict = analyseEdf({load(0.1, 0.05), load(10.0, 0.14, 0.3, 0.01)});
  EXPECT_TRUE(verdict.feasible);
  EXPECT_NEAR(0.3 - 3 * 0.05 - 0.14, verdict.blocking_budget_s, 1e-9);
}

TEST(EdfAdmission, NoJobOfAFeasibleSetIsEverLateWhateverTheBatchWorkWithinTheBudget)
{
  std::mt19937 random(11);
  int feasible = 0;
  for (int round = 0; round < 3000; ++round)
  {
    const std::vector<PeriodicLoad> loads = randomSet(random);
    const EdfVerdict verdict = analyseEdf(loads);
    if (!verdict.feasible)
    {
      continue;
    }
    ++feasible;
    EXPECT_LT(simulate(loads, 0.0, random, 100.0), 1e-6) << "round " << round;
    EXPECT_LT(simulate(loads, verdict.blocking_budget_s, random, 100.0), 1e-6) << "round " << round;
  }
  EXPECT_GT(feasible, 500);
}

TEST(EdfAdmission, MoreThanTheBudgetMakesSomeJobLate)
{
  // The critical instant: all loads are released together, just after batch work has begun (George et al. 1996).
  std::mt19937 random(12);
  int feasible = 0;
  for (int round = 0; round < 500; ++round)
  {
    std::vector<PeriodicLoad> loads = randomSet(random);
    const EdfVerdict verdict = analyseEdf(loads);
    if (!verdict.feasible)
    {
      continue;
    }
    ++feasible;
    double now = verdict.blocking_budget_s * 1.01 + 1e-6;
    bool late = false;
    std::vector<double> release(loads.size(), 0.0);
    std::vector<std::pair<double, double>> waiting;  // deadline, time
    const double horizon = 1000.0;
    while (now < horizon && !late)
    {
      for (size_t i = 0; i < loads.size(); ++i)
      {
        for (; release[i] <= now; release[i] += loads[i].period_s)
        {
          waiting.emplace_back(release[i] + loads[i].deadline_s, loads[i].wcet_s);
        }
      }
      if (waiting.empty())
      {
        break;  // the busy period is over
      }
      // Pre-emptive between releases, so that no load blocks another: only the batch work does.
      const auto first = std::min_element(waiting.begin(), waiting.end());
      const double piece = std::min(first->second, *std::min_element(release.begin(), release.end()) - now);
      now += piece;
      first->second -= piece;
      if (first->second <= 1e-12)
      {
        late = late || now > first->first;
        waiting.erase(first);
      }
    }
    EXPECT_TRUE(late) << "round " << round;
  }
  EXPECT_GT(feasible, 80);
}

}  // namespace
}  // namespace pi_runtime
