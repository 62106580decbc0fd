#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

#include <pi_runtime/inner_core_scheduler.h>
#include "dag_families.h"
#include "plan_check.h"
#include "scheduler/inner_core_problems.h"
#include "textbook_heft.h"

namespace pi_runtime
{
namespace
{

using pi_runtime_bench::DagFamily;
using pi_runtime_bench::makeDagProblem;

TEST(Heft, FindsTheRanksOfThePapersExample)
{
  const DagPlan plan = planned(with(InnerCorePolicy::HEFT), paperExample());
  const std::vector<double> ranks = {108.0, 77.0, 80.0, 80.0, 69.0, 63.333, 42.667, 35.667, 44.333, 14.667};
  for (std::size_t node = 0; node < ranks.size(); ++node)
  {
    EXPECT_NEAR(ranks[node], plan.rank[node], 5e-4) << "n" << node + 1;
  }
}

TEST(Heft, FindsTheScheduleOfThePapersExample)
{
  const DagPlan plan = planned(with(InnerCorePolicy::HEFT), paperExample());
  EXPECT_DOUBLE_EQ(80.0, plan.makespan);
  EXPECT_EQ((std::vector<uint32_t>{2, 0, 2, 1, 2, 1, 2, 0, 1, 1}), plan.unit);
  EXPECT_EQ((std::vector<double>{0, 27, 9, 18, 28, 26, 38, 57, 56, 73}), plan.start);
  EXPECT_EQ((std::vector<double>{9, 40, 28, 26, 38, 42, 49, 62, 68, 80}), plan.finish);
  EXPECT_EQ((std::vector<std::vector<uint32_t>>{{1, 7}, {3, 5, 8, 9}, {0, 2, 4, 6}}), plan.order);
  EXPECT_EQ((std::vector<uint32_t>{0, 1, 1, 1, 1, 1, 2, 2, 2, 3}), plan.level);
}

TEST(Heft, RelatesThePapersExampleToItsCriticalPath)
{
  // On the fastest processors n1, n2, n9, n10 take 9 + 13 + 12 + 7 s.
  const DagPlan plan = planned(with(InnerCorePolicy::HEFT), paperExample());
  EXPECT_DOUBLE_EQ(41.0, plan.critical_path);
  EXPECT_DOUBLE_EQ(80.0 / 41.0, plan.slr());
}

TEST(Heft, PlansAsTheTextbook)
{
  for (const DagProblem& problem : randomProblems(10, 1))
  {
    const double textbook = pi_runtime_bench::textbookHeft(problem.graph, problem.etc, problem.transfers);
    ASSERT_NEAR(textbook, planned(with(InnerCorePolicy::HEFT), problem).makespan, ROUNDING * textbook);
  }
}

TEST(Heft, PlansAsTheTextbookWithManyTies)
{
  for (const DagProblem& problem : roundedProblems(10, 16))
  {
    const double textbook = pi_runtime_bench::textbookHeft(problem.graph, problem.etc, problem.transfers);
    ASSERT_EQ(textbook, planned(with(InnerCorePolicy::HEFT), problem).makespan);
  }
}

TEST(Heft, FillsAGapOnlyWithInsertion)
{
  // Unit 0 waits for the data of the long node on unit 1; the short node, of lowest rank, fits in between.
  const DagProblem problem{TaskGraph(4, {{0, 2}, {1, 2}}), EtcMatrix(4, 2, {2, INF, INF, 10, 5, INF, 3, INF}),
                           TransferModel(2)};
  EXPECT_DOUBLE_EQ(2.0, planned(with(InnerCorePolicy::HEFT), problem).start[3]);
  EXPECT_DOUBLE_EQ(15.0, planned(with(InnerCorePolicy::HEFT, false), problem).start[3]);
}

TEST(Lookahead, PlansAsTheTextbook)
{
  for (const DagProblem& problem : randomProblems(4, 2))
  {
    const double textbook = pi_runtime_bench::textbookLookahead(problem.graph, problem.etc, problem.transfers);
    ASSERT_NEAR(textbook, planned(with(InnerCorePolicy::LOOKAHEAD), problem).makespan, ROUNDING * textbook);
  }
}

TEST(Lookahead, PlansAsTheTextbookWithManyTies)
{
  for (const DagProblem& problem : roundedProblems(10, 17))
  {
    const double textbook = pi_runtime_bench::textbookLookahead(problem.graph, problem.etc, problem.transfers);
    ASSERT_EQ(textbook, planned(with(InnerCorePolicy::LOOKAHEAD), problem).makespan);
  }
}

TEST(Lookahead, StaysWhereTheSuccessorHasToRun)
{
  // Unit 0 is a little faster for the first node, but only unit 1 can run the second, a transfer away.
  const DagProblem problem{TaskGraph(2, {{0, 1, 10}}), EtcMatrix(2, 2, {10, 11, INF, 5}), TransferModel(2, {0.0, 1.0})};
  EXPECT_DOUBLE_EQ(25.0, planned(with(InnerCorePolicy::HEFT), problem).makespan);
  EXPECT_DOUBLE_EQ(16.0, planned(with(InnerCorePolicy::LOOKAHEAD), problem).makespan);
}

TEST(Lookahead, GainsOnAverageWhereTransfersDominate)
{
  std::mt19937_64 random(3);
  double ratio = 0.0;
  const int graphs = 100;
  for (int i = 0; i < graphs; ++i)
  {
    const DagProblem problem = makeDagProblem(DagFamily::GAUSS, {4, true, 5.0}, &random);
    ratio += planned(with(InnerCorePolicy::LOOKAHEAD), problem).makespan /
             planned(with(InnerCorePolicy::HEFT), problem).makespan / graphs;
  }
  EXPECT_LT(ratio, 0.97);
}

TEST(Levels, StartNothingBeforeTheLevelsAboveAreDone)
{
  int earlier_without = 0;
  for (const DagProblem& problem : randomProblems(2, 4))
  {
    for (const LevelMapping mapping : {LevelMapping::RANK, LevelMapping::MIN_MIN, LevelMapping::DIFF_MIN})
    {
      const DagPlan plan = planned(levels(mapping, true), problem);
      for (uint32_t node = 0; node < problem.graph.nodes(); ++node)
      {
        for (uint32_t other = 0; other < problem.graph.nodes(); ++other)
        {
          ASSERT_TRUE(plan.level[other] >= plan.level[node] || plan.finish[other] <= plan.start[node]);
        }
      }
      const DagPlan free = planned(levels(mapping, false), problem);
      const auto broken =
          validatePlan(problem.graph, problem.etc, problem.transfers, free, StartTimes(), /*barrier=*/true);
      earlier_without += broken ? 1 : 0;
    }
  }
  EXPECT_GT(earlier_without, 100) << "without the barrier some nodes of most graphs start earlier";
}

TEST(Levels, WaitForTheSlowestNodeOfALevel)
{
  // Node 0 feeds node 2, both short; node 1 is long. Two units.
  const DagProblem problem{TaskGraph(3, {{0, 2}}), EtcMatrix(3, 2, {1, 1, 10, 10, 1, 1}), TransferModel(2)};
  EXPECT_DOUBLE_EQ(10.0, planned(levels(LevelMapping::MIN_MIN, true), problem).start[2]);
  EXPECT_DOUBLE_EQ(1.0, planned(levels(LevelMapping::MIN_MIN, false), problem).start[2]);
}

/// Min-Min on independent tasks, by looking at every pair in every round.
double plainMinMin(const EtcMatrix& etc)
{
  std::vector<double> load(etc.units(), 0.0);
  std::vector<bool> mapped(etc.tasks(), false);
  for (std::size_t round = 0; round < etc.tasks(); ++round)
  {
    double best = INF;
    std::size_t best_task = 0;
    std::size_t best_unit = 0;
    for (std::size_t task = 0; task < etc.tasks(); ++task)
    {
      for (std::size_t unit = 0; unit < etc.units(); ++unit)
      {
        if (!mapped[task] && load[unit] + etc.at(task, unit) < best)
        {
          best = load[unit] + etc.at(task, unit);
          best_task = task;
          best_unit = unit;
        }
      }
    }
    load[best_unit] = best;
    mapped[best_task] = true;
  }
  return *std::max_element(load.begin(), load.end());
}

/// Diff-Min on independent tasks without infinite times, by the formal steps of π-Edge, section IV.B.
double plainDiffMin(const EtcMatrix& etc)
{
  std::vector<std::size_t> tasks(etc.tasks());
  std::iota(tasks.begin(), tasks.end(), 0);
  const auto div = [&](std::size_t task)
  {
    const auto [low, high] = std::minmax_element(etc.row(task), etc.row(task) + etc.units());
    return *high / *low;
  };
  std::sort(tasks.begin(), tasks.end(), [&](std::size_t a, std::size_t b) { return div(a) > div(b); });
  std::vector<double> load(etc.units(), 0.0);
  for (const std::size_t task : tasks)
  {
    std::vector<double> completion = load;
    for (std::size_t unit = 0; unit < etc.units(); ++unit)
    {
      completion[unit] += etc.at(task, unit);
    }
    const auto best = std::min_element(completion.begin(), completion.end());
    load[static_cast<std::size_t>(best - completion.begin())] = *best;
  }
  return *std::max_element(load.begin(), load.end());
}

TEST(Levels, MapIndependentTasksWithMinMin)
{
  std::mt19937_64 random(5);
  for (int i = 0; i < 100; ++i)
  {
    const EtcMatrix etc = randomTimes(25, 4, i % 2 == 0 ? 0.0 : 0.25, &random);
    const DagPlan plan = planned(levels(LevelMapping::MIN_MIN, true), independentTasks(etc));
    ASSERT_DOUBLE_EQ(plainMinMin(etc), plan.makespan);
  }
}

TEST(Levels, MapIndependentTasksWithDiffMin)
{
  std::mt19937_64 random(6);
  for (int i = 0; i < 100; ++i)
  {
    const EtcMatrix etc = randomTimes(25, 4, 0.0, &random);
    const DagPlan plan = planned(levels(LevelMapping::DIFF_MIN, true), independentTasks(etc));
    ASSERT_DOUBLE_EQ(plainDiffMin(etc), plan.makespan);
  }
}

TEST(Levels, MapWithDiffMinFirstWhatFewerUnitsCanRun)
{
  // Node 0 has the larger Div of the finite times, but node 1 has one unit to go to.
  const DagPlan plan = planned(levels(LevelMapping::DIFF_MIN, true), independentTasks(EtcMatrix(2, 2, {1, 9, 5, INF})));
  EXPECT_DOUBLE_EQ(0.0, plan.start[1]);
}

TEST(Levels, MapWithDiffMinByTheLargerDifferenceWhereTheRatiosAreEqual)
{
  // Div is 2 for both; Sub is 28 s and 30 s, although the first node takes longer on average. Both want unit 0.
  const DagPlan plan =
      planned(levels(LevelMapping::DIFF_MIN, true), independentTasks(EtcMatrix(2, 3, {28, 56, 56, 30, 60, 30})));
  EXPECT_EQ((std::vector<uint32_t>{1, 0}), plan.unit);
}

TEST(Levels, MapWithDiffMinByRankWhereUnitsAreAlike)
{
  std::mt19937_64 random(7);
  for (int i = 0; i < 50; ++i)
  {
    const DagProblem problem = makeDagProblem(DagFamily::RANDOM, {4, false, 1.0}, &random);
    ASSERT_EQ(planned(levels(LevelMapping::RANK, true), problem).start,
              planned(levels(LevelMapping::DIFF_MIN, true), problem).start);
  }
}

}  // namespace
}  // namespace pi_runtime
