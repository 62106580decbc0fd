#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <pi_runtime/inner_core_scheduler.h>
#include "dag_families.h"
#include "plan_check.h"
#include "scheduler/inner_core_problems.h"

namespace pi_runtime
{
namespace
{

using pi_runtime_bench::DAG_FAMILIES;
using pi_runtime_bench::DagFamily;
using pi_runtime_bench::makeDagProblem;

TEST(InnerCoreScheduler, MakesValidPlansWithEveryPolicy)
{
  for (const DagProblem& problem : randomProblems(6, 8))
  {
    for (const InnerCoreOptions& options : allOptions())
    {
      planned(options, problem);
    }
    ASSERT_FALSE(HasFailure());
  }
}

TEST(InnerCoreScheduler, NeverGoesBelowTheLowerBounds)
{
  for (const DagProblem& problem : randomProblems(3, 9))
  {
    std::vector<double> chain(problem.graph.nodes(), 0.0);  // longest one that ends with the node
    double work = 0.0;
    for (const uint32_t node : problem.graph.topologicalOrder())
    {
      const double* row = problem.etc.row(node);
      const double fastest = *std::min_element(row, row + problem.etc.units());
      for (const TaskGraph::Link& link : problem.graph.predecessors(node))
      {
        chain[node] = std::max(chain[node], chain[link.node]);
      }
      chain[node] += fastest;
      work += fastest;
    }
    const double critical_path = *std::max_element(chain.begin(), chain.end());
    for (const InnerCoreOptions& options : allOptions())
    {
      const DagPlan plan = planned(options, problem);
      ASSERT_NEAR(critical_path, plan.critical_path, ROUNDING * critical_path);
      ASSERT_GE(plan.makespan, critical_path * (1.0 - ROUNDING));
      ASSERT_GE(plan.makespan, work / static_cast<double>(problem.etc.units()) * (1.0 - ROUNDING));
    }
  }
}

TEST(InnerCoreScheduler, HonoursAvailableAndReleaseTimes)
{
  std::mt19937_64 random(10);
  std::uniform_real_distribution<double> draw(0.0, 0.02);  // graphs take 5 to 50 ms
  for (const DagProblem& problem : randomProblems(2, 10))
  {
    StartTimes start_times{std::vector<double>(problem.etc.units()), std::vector<double>(problem.graph.nodes())};
    std::generate(start_times.available.begin(), start_times.available.end(), [&] { return draw(random); });
    std::generate(start_times.release.begin(), start_times.release.end(), [&] { return draw(random); });
    for (const InnerCoreOptions& options : allOptions())
    {
      planned(options, problem, start_times);
    }
    ASSERT_FALSE(HasFailure());
  }
}

TEST(InnerCoreScheduler, StartsAsSoonAsUnitAndDataAreThere)
{
  const DagProblem problem{TaskGraph(2, {{0, 1}}), EtcMatrix(2, 1, {2.0, 3.0}), TransferModel(1)};
  for (const InnerCoreOptions& options : allOptions())
  {
    EXPECT_DOUBLE_EQ(4.0, planned(options, problem, {{4.0}, {}}).start[0]) << name(options);
    EXPECT_DOUBLE_EQ(7.0, planned(options, problem, {{}, {0.0, 7.0}}).start[1]) << name(options);
    EXPECT_DOUBLE_EQ(10.0, planned(options, problem, {{4.0}, {0.0, 7.0}}).makespan) << name(options);
  }
}

TEST(InnerCoreScheduler, AvoidsAUnitThatIsBusy)
{
  const DagProblem problem = independentTasks(EtcMatrix(1, 2, {1.0, 2.0}));
  EXPECT_EQ(0U, planned(with(InnerCorePolicy::HEFT), problem).unit[0]);
  EXPECT_EQ(1U, planned(with(InnerCorePolicy::HEFT), problem, {{1.5, 0.0}, {}}).unit[0]);
}

TEST(InnerCoreScheduler, PlansTheEmptyGraph)
{
  for (const InnerCoreOptions& options : allOptions())
  {
    const DagPlan plan = planned(options, {TaskGraph(), EtcMatrix(0, 2), TransferModel(2)});
    EXPECT_EQ(0.0, plan.makespan);
    EXPECT_EQ(2U, plan.order.size());
    EXPECT_EQ(1.0, plan.slr());
  }
}

TEST(InnerCoreScheduler, PutsASingleNodeOnItsFastestUnit)
{
  for (const InnerCoreOptions& options : allOptions())
  {
    const DagPlan plan = planned(options, independentTasks(EtcMatrix(1, 3, {3.0, 2.0, INF})));
    EXPECT_EQ(1U, plan.unit[0]);
    EXPECT_DOUBLE_EQ(2.0, plan.makespan);
  }
}

TEST(InnerCoreScheduler, NeverLeavesASingleUnitIdle)
{
  std::mt19937_64 random(11);
  for (const DagFamily family : DAG_FAMILIES)
  {
    const DagProblem problem = makeDagProblem(family, {1, false, 0.0}, &random);
    double work = 0.0;
    for (uint32_t node = 0; node < problem.graph.nodes(); ++node)
    {
      work += problem.etc.at(node, 0);
    }
    for (const InnerCoreOptions& options : allOptions())
    {
      EXPECT_NEAR(work, planned(options, problem).makespan, ROUNDING * work) << name(options);
    }
  }
}

TEST(InnerCoreScheduler, KeepsAChainOnOneUnitWhereTransfersCost)
{
  std::vector<TaskGraph::Edge> edges;
  for (uint32_t node = 0; node + 1 < 20; ++node)
  {
    edges.push_back({node, node + 1, 1.0});
  }
  const DagProblem problem{TaskGraph(20, edges), EtcMatrix(20, 3, std::vector<double>(60, 1.0)),
                           TransferModel(3, {0.5, INF})};
  for (const InnerCoreOptions& options : allOptions())
  {
    EXPECT_DOUBLE_EQ(20.0, planned(options, problem).makespan) << name(options);
  }
}

TEST(InnerCoreScheduler, RunsUnconnectedGraphsSideBySide)
{
  // Two chains of three nodes of 1 s.
  const DagProblem problem{TaskGraph(6, {{0, 1, 1}, {1, 2, 1}, {3, 4, 1}, {4, 5, 1}}),
                           EtcMatrix(6, 2, std::vector<double>(12, 1.0)), TransferModel(2, {0.0, 0.5})};
  for (const InnerCoreOptions& options : allOptions())
  {
    EXPECT_DOUBLE_EQ(3.0, planned(options, problem).makespan) << name(options);
  }
}

TEST(InnerCoreScheduler, BreaksTiesByNodeAndUnitNumber)
{
  const DagProblem problem = independentTasks(EtcMatrix(6, 3, std::vector<double>(18, 1.0)));
  for (const InnerCoreOptions& options : allOptions())
  {
    EXPECT_EQ((std::vector<uint32_t>{0, 1, 2, 0, 1, 2}), planned(options, problem).unit) << name(options);
  }
}

TEST(InnerCoreScheduler, ForgetsThePlanBefore)
{
  const std::vector<DagProblem> problems = randomProblems(1, 12);  // of all sizes, with different numbers of units
  for (const InnerCoreOptions& options : allOptions())
  {
    InnerCoreScheduler used(options);
    DagPlan plan;
    for (const DagProblem& problem : problems)
    {
      used.schedule(problem.graph, problem.etc, problem.transfers, StartTimes(), &plan);
      const DagPlan fresh = InnerCoreScheduler(options).schedule(problem.graph, problem.etc, problem.transfers);
      ASSERT_EQ(fresh.unit, plan.unit);
      ASSERT_EQ(fresh.start, plan.start);
      ASSERT_EQ(fresh.order, plan.order);
      ASSERT_EQ(fresh.rank, plan.rank);
      ASSERT_EQ(fresh.makespan, plan.makespan);
      ASSERT_EQ(fresh.critical_path, plan.critical_path);
    }
  }
}

TEST(InnerCoreScheduler, ListsNodesThatNoUnitCanRunAndPlansNothing)
{
  DagProblem problem = paperExample();
  for (const std::size_t unit : {0, 1, 2})
  {
    problem.etc.at(3, unit) = INF;
    problem.etc.at(8, unit) = INF;
  }
  for (const InnerCoreOptions& options : allOptions())
  {
    const DagPlan plan = planned(options, problem);
    EXPECT_FALSE(plan.feasible());
    EXPECT_EQ((std::vector<uint32_t>{3, 8}), plan.infeasible);
    EXPECT_EQ(std::vector<uint32_t>(10, DagPlan::NO_UNIT), plan.unit);
  }
}

TEST(InnerCoreScheduler, IsFeasibleAgainAfterAnInfeasiblePlan)
{
  InnerCoreScheduler scheduler;
  DagProblem problem = independentTasks(EtcMatrix(1, 1, {INF}));
  DagPlan plan;
  scheduler.schedule(problem.graph, problem.etc, problem.transfers, {}, &plan);
  EXPECT_FALSE(plan.feasible());
  problem.etc.at(0, 0) = 1.0;
  scheduler.schedule(problem.graph, problem.etc, problem.transfers, {}, &plan);
  EXPECT_TRUE(plan.feasible());
  EXPECT_DOUBLE_EQ(1.0, plan.makespan);
}

TEST(InnerCoreScheduler, AveragesRanksOverTheUnitsThatCanRunANode)
{
  const DagPlan plan =
      planned(with(InnerCorePolicy::HEFT), independentTasks(EtcMatrix(2, 3, {2, INF, 4, INF, INF, 5})));
  EXPECT_DOUBLE_EQ(3.0, plan.rank[0]);
  EXPECT_DOUBLE_EQ(5.0, plan.rank[1]);
}

TEST(InnerCoreScheduler, PlansThousandsOfNodes)
{
  std::mt19937_64 random(13);
  const uint32_t nodes = 5000;
  std::vector<TaskGraph::Edge> edges;
  for (uint32_t node = 1; node < nodes; ++node)  // two predecessors each, at most 100 nodes back
  {
    const uint32_t span = std::min<uint32_t>(node, 100);
    const uint32_t first = node - std::uniform_int_distribution<uint32_t>(1, span)(random);
    const uint32_t second = node - std::uniform_int_distribution<uint32_t>(1, span)(random);
    edges.push_back({first, node, 3.0});
    if (second != first)
    {
      edges.push_back({second, node, 3.0});
    }
  }
  const DagProblem deep{TaskGraph(nodes, edges), randomTimes(nodes, 4, 0.1, &random), TransferModel(4, {0.1, 1.0})};
  const DagProblem wide = independentTasks(randomTimes(nodes, 4, 0.1, &random));
  for (const InnerCoreOptions& options : allOptions())
  {
    planned(options, deep);
    planned(options, wide);
  }
}

TEST(InnerCoreScheduler, StandsTimesTooShortToCount)
{
  std::mt19937_64 random(15);
  for (DagProblem problem : randomProblems(2, 15))
  {
    for (uint32_t node = 0; node < problem.graph.nodes(); ++node)
    {
      for (std::size_t unit = 0; random() % 3 == 0 && unit < problem.etc.units(); ++unit)
      {
        problem.etc.at(node, unit) *= 1e-200;  // added to any other time it changes nothing
      }
    }
    for (const InnerCoreOptions& options : allOptions())
    {
      planned(options, problem);
    }
    ASSERT_FALSE(HasFailure());
  }
}

/// @return message of the exception that the call throws; empty if there is none.
template <typename Call>
std::string refusal(const Call& call)
{
  try
  {
    call();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(InnerCoreScheduler, RefusesSizesThatDoNotAgree)
{
  const DagProblem problem = paperExample();
  InnerCoreScheduler scheduler;
  const auto refused = [&](const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                           const StartTimes& start_times = StartTimes())
  { return refusal([&] { scheduler.schedule(graph, etc, transfers, start_times); }); };
  EXPECT_NE(std::string::npos,
            refused(TaskGraph(9, {}), problem.etc, problem.transfers).find("nodes of the graph = 9"));
  EXPECT_NE(std::string::npos, refused(problem.graph, problem.etc, TransferModel(2)).find("transfer model = 2"));
  EXPECT_NE(std::string::npos, refused(TaskGraph(), EtcMatrix(0, 0), TransferModel(0)).find("0 units"));
  EXPECT_NE(std::string::npos,
            refused(problem.graph, problem.etc, problem.transfers, {{0.0, 0.0}, {}}).find("2 available times"));
  EXPECT_NE(std::string::npos,
            refused(problem.graph, problem.etc, problem.transfers, {{}, {0.0}}).find("1 release times"));
}

TEST(InnerCoreScheduler, RefusesImpossibleTimesAndLeavesThePlanUntouched)
{
  const DagProblem problem = independentTasks(EtcMatrix(1, 2, {1.0, 2.0}));
  InnerCoreScheduler scheduler;
  DagPlan plan;
  plan.makespan = 42.0;
  const auto refused = [&](const EtcMatrix& etc, const StartTimes& start_times)
  { return refusal([&] { scheduler.schedule(problem.graph, etc, problem.transfers, start_times, &plan); }); };
  EXPECT_NE(std::string::npos, refused(problem.etc, {{0.0, -1.0}, {}}).find("available time 1"));
  EXPECT_NE(std::string::npos, refused(problem.etc, {{}, {std::nan("")}}).find("release time 0"));
  EXPECT_NE(std::string::npos, refused(problem.etc, {{INF, 0.0}, {}}).find("available time 0"));
  EXPECT_NE("", refused(EtcMatrix(1, 2, {1.0, 0.0}), {}));
  EXPECT_NE("", refused(EtcMatrix(1, 2, {std::nan(""), 1.0}), {}));
  EXPECT_EQ(42.0, plan.makespan);
  EXPECT_TRUE(plan.order.empty());
}

TEST(InnerCoreScheduler, RefusesTimesThatAddUpToInfinity)
{
  const double longest = std::numeric_limits<double>::max();
  const DagProblem problem{TaskGraph(2, {{0, 1}}), EtcMatrix(2, 2, std::vector<double>(4, longest)), TransferModel(2)};
  for (const InnerCoreOptions& options : allOptions())
  {
    InnerCoreScheduler scheduler(options);
    const std::string text =
        refusal([&] { scheduler.schedule(problem.graph, problem.etc, problem.transfers, StartTimes()); });
    EXPECT_NE(std::string::npos, text.find("node 1 would never finish")) << name(options) << ": " << text;
    const DagProblem next = paperExample();
    EXPECT_TRUE(scheduler.schedule(next.graph, next.etc, next.transfers).feasible()) << name(options);
  }
}

TEST(RecommendedPolicy, LooksAheadWhereTransfersTakeAsLongAsTheWork)
{
  std::mt19937_64 random(14);
  for (const DagFamily family : DAG_FAMILIES)
  {
    for (const double ccr : {0.5, 0.99, 1.01, 5.0})
    {
      const DagProblem problem = makeDagProblem(family, {4, true, ccr}, &random);
      EXPECT_NEAR(ccr, communicationToComputation(problem.graph, problem.etc, problem.transfers), 1e-9);
      EXPECT_EQ(ccr < 1.0 ? InnerCorePolicy::HEFT : InnerCorePolicy::LOOKAHEAD,
                recommendedPolicy(problem.graph, problem.etc, problem.transfers));
    }
  }
}

TEST(RecommendedPolicy, IsHeftWithoutTransfers)
{
  const EtcMatrix etc(2, 1, {1.0, 1.0});
  EXPECT_EQ(InnerCorePolicy::HEFT, recommendedPolicy(TaskGraph(2, {}), etc, TransferModel(1)));
  EXPECT_EQ(InnerCorePolicy::HEFT, recommendedPolicy(TaskGraph(2, {{0, 1, 9.0}}), etc, TransferModel(1, {9.0, 1.0})));
  EXPECT_EQ(0.0, communicationToComputation(TaskGraph(), EtcMatrix(0, 1), TransferModel(1)));
}

TEST(RecommendedPolicy, LeavesOutNodesThatNoUnitCanRun)
{
  // Node 0 takes 3 s on average, node 1 cannot run, the transfer takes 6 s.
  const EtcMatrix etc(2, 2, {2.0, 4.0, INF, INF});
  EXPECT_DOUBLE_EQ(2.0, communicationToComputation(TaskGraph(2, {{0, 1, 6.0}}), etc, TransferModel(2, {0.0, 1.0})));
}

TEST(InnerCorePolicy, IsReadAsItIsWritten)
{
  for (const InnerCorePolicy policy : {InnerCorePolicy::LEVELS, InnerCorePolicy::HEFT, InnerCorePolicy::LOOKAHEAD})
  {
    EXPECT_EQ(policy, parseInnerCorePolicy(toString(policy)));
  }
  EXPECT_EQ(InnerCorePolicy::LEVELS, parseInnerCorePolicy("levels"));
  const std::string text = refusal([] { parseInnerCorePolicy("heftt"); });
  EXPECT_NE(std::string::npos, text.find("\"heftt\"")) << text;
  EXPECT_NE(std::string::npos, text.find("levels, heft, lookahead")) << text;
}

TEST(LevelMapping, IsReadAsItIsWritten)
{
  for (const LevelMapping mapping : {LevelMapping::RANK, LevelMapping::MIN_MIN, LevelMapping::DIFF_MIN})
  {
    EXPECT_EQ(mapping, parseLevelMapping(toString(mapping)));
  }
  EXPECT_EQ(LevelMapping::DIFF_MIN, parseLevelMapping("diff_min"));
  EXPECT_NE(std::string::npos, refusal([] { parseLevelMapping(""); }).find("rank, min_min, diff_min"));
}

}  // namespace
}  // namespace pi_runtime
