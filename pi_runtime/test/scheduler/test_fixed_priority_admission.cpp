// Response times under fixed priorities, against examples of the literature and a simulation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "scheduler/fixed_priority_admission.h"

namespace pi_runtime
{
namespace
{

PeriodicLoad load(double period, double deadline, double wcet, int priority)
{
  return {period, deadline, wcet, wcet, priority};
}

TEST(FixedPriorityAdmission, GivesTheResponseTimesOfBurnsAndWellings)
{
  // Burns and Wellings, Real-Time Systems and Programming Languages, response-time analysis: process set D.
  const FixedPriorityVerdict verdict = analyseFixedPriority({load(7, 7, 3, 3), load(12, 12, 3, 2), load(20, 20, 5, 1)});
  EXPECT_TRUE(verdict.feasible);
  ASSERT_EQ(3u, verdict.response_s.size());
  EXPECT_DOUBLE_EQ(3, verdict.response_s[0]);
  EXPECT_DOUBLE_EQ(6, verdict.response_s[1]);
  EXPECT_DOUBLE_EQ(20, verdict.response_s[2]);
}

TEST(FixedPriorityAdmission, RefusesTheirSetThatMisses)
{
  // The same, process set A: utilisation 0.82, the lowest process needs 52 of 50.
  const FixedPriorityVerdict verdict =
      analyseFixedPriority({load(30, 30, 10, 3), load(40, 40, 10, 2), load(50, 50, 12, 1)});
  EXPECT_FALSE(verdict.feasible);
  EXPECT_DOUBLE_EQ(52, verdict.response_s[2]);
}

TEST(FixedPriorityAdmission, AcceptsHarmonicPeriodsUpToFullUse)
{
  // The same, process set C: utilisation 1 is possible with harmonic periods; it counts as full here, 0.998 does not.
  EXPECT_FALSE(analyseFixedPriority({load(20, 20, 5, 3), load(40, 40, 10, 2), load(80, 80, 40, 1)}).feasible);
  EXPECT_TRUE(analyseFixedPriority({load(20, 20, 5, 3), load(40, 40, 10, 2), load(80, 80, 39.8, 1)}).feasible);
}

TEST(FixedPriorityAdmission, LooksAtTheWholeBusyPeriodWhereDeadlinesArePastPeriods)
{
  // Lehoczky 1990: T = 70, 100 and C = 26, 62. Not the first job of the second is the latest: 114, 102, 116, 104, 118,
  // 106, 94.
  const FixedPriorityVerdict verdict = analyseFixedPriority({load(70, 70, 26, 2), load(100, 120, 62, 1)});
  EXPECT_DOUBLE_EQ(118, verdict.response_s[1]);
  EXPECT_TRUE(verdict.feasible);
  EXPECT_FALSE(analyseFixedPriority({load(70, 70, 26, 2), load(100, 117, 62, 1)}).feasible);
}

TEST(FixedPriorityAdmission, CountsEqualPrioritiesAsDisturbingEachOther)
{
  const FixedPriorityVerdict verdict = analyseFixedPriority({load(30, 30, 5, 1), load(30, 30, 7, 1)});
  EXPECT_DOUBLE_EQ(12, verdict.response_s[0]);
  EXPECT_DOUBLE_EQ(12, verdict.response_s[1]);
}

TEST(FixedPriorityAdmission, TellsHowLongTheOrdinaryClassWaitsAndMayBeHeldUp)
{
  const FixedPriorityVerdict verdict =
      analyseFixedPriority({load(0.033, 0.033, 0.008, 12), load(0.1, 0.1, 0.01, 11), load(0.2, 0.2, 0.05, 0)});
  EXPECT_TRUE(verdict.feasible);
  EXPECT_NEAR(0.018, verdict.longest_realtime_s, 1e-8);
  // 50 + 10 + 3 x 8 = 84 ms of 200.
  EXPECT_NEAR(0.084, verdict.response_s[2], 1e-9);
  EXPECT_NEAR(0.116, verdict.blocking_budget_s, 1e-9);
  EXPECT_TRUE(std::isinf(analyseFixedPriority({load(0.033, 0.033, 0.008, 12)}).blocking_budget_s));
}

TEST(FixedPriorityAdmission, SaysNeverForAnOverloadedUnit)
{
  const FixedPriorityVerdict verdict = analyseFixedPriority({load(10, 10, 6, 2), load(20, 40, 10, 1)});
  EXPECT_DOUBLE_EQ(6, verdict.response_s[0]);
  EXPECT_TRUE(std::isinf(verdict.response_s[1]));
  EXPECT_FALSE(verdict.feasible);
}

TEST(FixedPriorityAdmission, IsNeverShorterThanASimulation)
{
  std::mt19937 random(7);
  for (int set = 0; set < 200; ++set)
  {
    std::vector<PeriodicLoad> loads;
    const int count = std::uniform_int_distribution<int>(2, 5)(random);
    for (int i = 0; i < count; ++i)
    {
      const int period = std::uniform_int_distribution<int>(5, 40)(random);
      const int wcet = std::uniform_int_distribution<int>(1, std::max(1, period / count))(random);
      loads.push_back(load(period, 2 * period, wcet, std::uniform_int_distribution<int>(1, 3)(random)));
    }
    const FixedPriorityVerdict verdict = analyseFixedPriority(loads);
    if (!verdict.feasible)
    {
      continue;
    }
    // All released together, in steps of 1; equal priorities go by the first release, and do not interrupt each other.
    struct Job
    {
      int release;
      int left;
      size_t of;
      bool begun;
    };
    std::vector<Job> open;
    std::vector<double> worst(loads.size(), 0.0);
    for (int now = 0; now < 2000; ++now)
    {
      for (size_t i = 0; i < loads.size(); ++i)
      {
        if (now % static_cast<int>(loads[i].period_s) == 0)
        {
          open.push_back({now, static_cast<int>(loads[i].wcet_s), i, false});
        }
      }
      const auto next =
          std::min_element(open.begin(), open.end(),
                           [&loads](const Job& a, const Job& b)
                           {
                             const int pa = loads[a.of].priority;
                             const int pb = loads[b.of].priority;
                             return pa != pb ? pa > pb : a.begun != b.begun ? a.begun : a.release < b.release;
                           });
      if (next == open.end())
      {
        continue;
      }
      next->begun = true;
      if (--next->left == 0)
      {
        worst[next->of] = std::max(worst[next->of], now + 1.0 - next->release);
        open.erase(next);
      }
    }
    for (size_t i = 0; i < loads.size(); ++i)
    {
      EXPECT_LE(worst[i], verdict.response_s[i]) << "set " << set << ", load " << i;
    }
  }
}

TEST(FixedPriorityAdmission, GivesPrioritiesByDeadlinesInAFewLevels)
{
  EXPECT_EQ(HIGHEST_PRIORITY, priorityOf(0.001));
  EXPECT_EQ(HIGHEST_PRIORITY, priorityOf(0.005));
  EXPECT_EQ(12, priorityOf(0.033));
  EXPECT_EQ(11, priorityOf(0.05));
  EXPECT_EQ(LOWEST_PRIORITY, priorityOf(0.1));
  EXPECT_EQ(LOWEST_PRIORITY, priorityOf(10.0));
}

}  // namespace
}  // namespace pi_runtime
