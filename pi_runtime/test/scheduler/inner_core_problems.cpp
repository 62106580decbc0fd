#include "scheduler/inner_core_problems.h"
#include "plan_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

namespace pi_runtime
{
namespace
{

bool demandsBarrier(const InnerCoreOptions& options)
{
  return options.policy == InnerCorePolicy::LEVELS && options.level_barrier;
}

}  // namespace

InnerCoreOptions with(InnerCorePolicy policy, bool insertion)
{
  InnerCoreOptions options;
  options.policy = policy;
  options.insertion = insertion;
  return options;
}

InnerCoreOptions levels(LevelMapping mapping, bool barrier, bool insertion)
{
  InnerCoreOptions options = with(InnerCorePolicy::LEVELS, insertion);
  options.level_mapping = mapping;
  options.level_barrier = barrier;
  return options;
}

std::vector<InnerCoreOptions> allOptions()
{
  std::vector<InnerCoreOptions> all;
  for (const bool insertion : {true, false})
  {
    all.push_back(with(InnerCorePolicy::HEFT, insertion));
    all.push_back(with(InnerCorePolicy::LOOKAHEAD, insertion));
    for (const LevelMapping mapping : {LevelMapping::RANK, LevelMapping::MIN_MIN, LevelMapping::DIFF_MIN})
    {
      all.push_back(levels(mapping, true, insertion));
      all.push_back(levels(mapping, false, insertion));
    }
  }
  return all;
}

std::string name(const InnerCoreOptions& options)
{
  std::string text = toString(options.policy);
  if (options.policy == InnerCorePolicy::LEVELS)
  {
    text += std::string(" ") + toString(options.level_mapping) + (options.level_barrier ? " barrier" : "");
  }
  return text + (options.insertion ? " insertion" : "");
}

DagPlan planned(const InnerCoreOptions& options, const DagProblem& problem, const StartTimes& start_times)
{
  DagPlan plan = InnerCoreScheduler(options).schedule(problem.graph, problem.etc, problem.transfers, start_times);
  const auto finding =
      validatePlan(problem.graph, problem.etc, problem.transfers, plan, start_times, demandsBarrier(options));
  EXPECT_FALSE(finding) << name(options) << ": " << *finding;
  return plan;
}

DagProblem independentTasks(EtcMatrix etc)
{
  const auto units = etc.units();
  return {TaskGraph(static_cast<uint32_t>(etc.tasks()), {}), std::move(etc), TransferModel(units)};
}

EtcMatrix randomTimes(std::size_t tasks, std::size_t units, double infinite_share, std::mt19937_64* random)
{
  std::uniform_real_distribution<double> draw(0.0, 1.0);
  EtcMatrix etc(tasks, units);
  for (std::size_t task = 0; task < tasks; ++task)
  {
    for (std::size_t unit = 0; unit < units; ++unit)
    {
      const bool infinite = unit != task % units && draw(*random) < infinite_share;
      etc.at(task, unit) = infinite ? INF : 1.0 + 29.0 * draw(*random);
    }
  }
  return etc;
}

std::vector<DagProblem> randomProblems(int per_setting, uint64_t seed)
{
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> draw(0.0, 1.0);
  std::vector<DagProblem> problems;
  for (const auto family : pi_runtime_bench::DAG_FAMILIES)
  {
    for (const bool heterogeneous : {false, true})
    {
      for (const double ccr : {0.0, 1.0, 5.0})
      {
        for (int i = 0; i < per_setting; ++i)
        {
          const uint32_t units = std::uniform_int_distribution<uint32_t>(2, 8)(random);
          problems.push_back(makeDagProblem(family, {units, heterogeneous, ccr}, &random));
          EtcMatrix& etc = problems.back().etc;
          for (std::size_t node = 0; i % 3 == 2 && node < etc.tasks(); ++node)
          {
            const std::size_t unit = node % (units - 1) + 1;  // unit 0 can run everything
            etc.at(node, unit) = draw(random) < 0.3 ? INF : etc.at(node, unit);
          }
        }
      }
    }
  }
  return problems;
}

std::vector<DagProblem> roundedProblems(int per_setting, uint64_t seed)
{
  std::vector<DagProblem> problems = randomProblems(per_setting, seed);
  for (DagProblem& problem : problems)
  {
    constexpr double UNIT = 0.5e-3;  // [s]; nodes then take 1 to 6 of it, most of them
    const TransferModel::Mean transfer = problem.transfers.mean();
    std::vector<TaskGraph::Edge> edges;
    for (uint32_t node = 0; node < problem.graph.nodes(); ++node)
    {
      for (std::size_t unit = 0; unit < problem.etc.units(); ++unit)
      {
        problem.etc.at(node, unit) = std::ceil(problem.etc.at(node, unit) / UNIT);
      }
      for (const TaskGraph::Link& link : problem.graph.successors(node))
      {
        edges.push_back({node, link.node, std::round(transfer.time(link.bytes) / UNIT)});
      }
    }
    problem.graph = TaskGraph(problem.graph.nodes(), edges);
    problem.transfers = TransferModel(problem.etc.units(), {0.0, 1.0});
  }
  return problems;
}

DagProblem paperExample()
{
  TaskGraph graph(10, {{0, 1, 18},
                       {0, 2, 12},
                       {0, 3, 9},
                       {0, 4, 11},
                       {0, 5, 14},
                       {1, 7, 19},
                       {1, 8, 16},
                       {2, 6, 23},
                       {3, 7, 27},
                       {3, 8, 23},
                       {4, 8, 13},
                       {5, 7, 15},
                       {6, 9, 17},
                       {7, 9, 11},
                       {8, 9, 13}});
  EtcMatrix etc(10, 3, {14, 16, 9, 13, 19, 18, 11, 13, 19, 13, 8,  17, 12, 13, 10,
                        13, 16, 9, 7,  15, 11, 5,  11, 14, 18, 12, 20, 21, 7,  16});
  return {graph, etc, TransferModel(3, {0.0, 1.0})};
}

}  // namespace pi_runtime
