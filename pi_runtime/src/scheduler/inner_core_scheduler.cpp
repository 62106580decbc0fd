#include <pi_runtime/inner_core_scheduler.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "scheduler/dag_placement.h"
#include "scheduler/inner_core_levels.h"
#include "scheduler/inner_core_lookahead.h"

namespace pi_runtime
{
/// What the units that can run a node need for it.
struct NodeTimes
{
  double mean;     // [s]; NaN if no unit can run it
  double fastest;  // [s]; +infinity if no unit can run it
};

namespace
{

constexpr std::array<std::pair<InnerCorePolicy, const char*>, 3> POLICIES = {
    {{InnerCorePolicy::LEVELS, "levels"}, {InnerCorePolicy::HEFT, "heft"}, {InnerCorePolicy::LOOKAHEAD, "lookahead"}}};
constexpr std::array<std::pair<LevelMapping, const char*>, 3> MAPPINGS = {
    {{LevelMapping::RANK, "rank"}, {LevelMapping::MIN_MIN, "min_min"}, {LevelMapping::DIFF_MIN, "diff_min"}}};

template <typename Names, typename Value>
const char* nameOf(const Names& names, Value value)
{
  const auto entry = std::find_if(names.begin(), names.end(), [&](const auto& name) { return name.first == value; });
  return entry == names.end() ? "unknown" : entry->second;
}

template <typename Names>
auto parse(const Names& names, const std::string& what, const std::string& text)
{
  std::string known;
  for (const auto& [value, name] : names)
  {
    if (text == name)
    {
      return value;
    }
    known += std::string(known.empty() ? "" : ", ") + name;
  }
  throw std::invalid_argument(what + " \"" + text + "\" is not known, must be one of: " + known);
}

void checkTimes(const std::string& what, const std::vector<double>& times, std::size_t wanted)
{
  if (times.empty())
  {
    return;
  }
  if (times.size() != wanted)
  {
    throw std::invalid_argument("inner-core scheduler: " + std::to_string(times.size()) + " " + what +
                                " times are given, must be none or " + std::to_string(wanted));
  }
  for (std::size_t i = 0; i < times.size(); ++i)
  {
    if (!std::isfinite(times[i]) || times[i] < 0)
    {
      throw std::invalid_argument("inner-core scheduler: " + what + " time " + std::to_string(i) + " = " +
                                  std::to_string(times[i]) + " s, must be finite and >= 0");
    }
  }
}

void checkSizes(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
{
  const auto refuse = [](const std::string& what, std::size_t got, const std::string& other, std::size_t wanted)
  {
    throw std::invalid_argument("inner-core scheduler: " + what + " = " + std::to_string(got) + ", must equal " +
                                other + " = " + std::to_string(wanted));
  };
  if (etc.tasks() != graph.nodes())
  {
    refuse("tasks of the ETC matrix", etc.tasks(), "nodes of the graph", graph.nodes());
  }
  if (transfers.units() != etc.units())
  {
    refuse("units of the transfer model", transfers.units(), "units of the ETC matrix", etc.units());
  }
  if (etc.units() == 0)
  {
    throw std::invalid_argument("inner-core scheduler: the ETC matrix has 0 units, must have at least one");
  }
}

NodeTimes timesOf(const EtcMatrix& etc, uint32_t node)
{
  double sum = 0.0;
  double fastest = std::numeric_limits<double>::infinity();
  int count = 0;
  for (std::size_t unit = 0; unit < etc.units(); ++unit)
  {
    const double time = etc.at(node, unit);
    if (std::isfinite(time))
    {
      sum += time;
      fastest = std::min(fastest, time);
      ++count;
    }
  }
  return {sum / count, fastest};
}

}  // namespace

const char* toString(InnerCorePolicy policy)
{
  return nameOf(POLICIES, policy);
}
const char* toString(LevelMapping mapping)
{
  return nameOf(MAPPINGS, mapping);
}

InnerCorePolicy parseInnerCorePolicy(const std::string& text)
{
  return parse(POLICIES, "inner-core policy", text);
}
LevelMapping parseLevelMapping(const std::string& text)
{
  return parse(MAPPINGS, "level mapping", text);
}

struct InnerCoreScheduler::Workspace
{
  std::vector<NodeTimes> times;   // per node
  std::vector<double> chain;      // per node: longest chain from its start to the end, on the fastest units [s]
  std::vector<uint32_t> by_rank;  // nodes by falling upward rank, predecessors first
  DagPlacement placement;
  LookaheadMapper lookahead;
  LevelMapper levels;

  void clearPlan(const TaskGraph& graph, const EtcMatrix& etc, DagPlan* plan);
  void rankNodes(const TaskGraph& graph, const TransferModel::Mean& transfer, DagPlan* plan);
  void finishPlan(DagPlan* plan) const;
};

void InnerCoreScheduler::Workspace::clearPlan(const TaskGraph& graph, const EtcMatrix& etc, DagPlan* plan)
{
  const uint32_t nodes = graph.nodes();
  plan->unit.assign(nodes, DagPlan::NO_UNIT);
  plan->start.assign(nodes, 0.0);
  plan->finish.assign(nodes, 0.0);
  plan->rank.assign(nodes, 0.0);
  plan->level.resize(nodes);
  plan->order.resize(etc.units());
  for (std::vector<uint32_t>& order : plan->order)
  {
    order.clear();
  }
  plan->makespan = 0.0;
  plan->critical_path = 0.0;
  plan->infeasible.clear();
  times.resize(nodes);
  for (uint32_t node = 0; node < nodes; ++node)
  {
    plan->level[node] = graph.level(node);
    times[node] = timesOf(etc, node);
    if (!std::isfinite(times[node].fastest))
    {
      plan->infeasible.push_back(node);
    }
  }
}

/// Upward ranks (Topcuoglu, Hariri, Wu 2002, eq. 5 and 6), the critical path, and the nodes by falling rank. The sort
/// is stable: where ranks are equal, as around nodes that take no time, predecessors stay in front.
void InnerCoreScheduler::Workspace::rankNodes(const TaskGraph& graph, const TransferModel::Mean& transfer,
                                              DagPlan* plan)
{
  chain.resize(graph.nodes());
  by_rank = graph.topologicalOrder();
  for (auto node = by_rank.rbegin(); node != by_rank.rend(); ++node)
  {
    double rank_after = 0.0;
    double chain_after = 0.0;
    for (const TaskGraph::Link& successor : graph.successors(*node))
    {
      rank_after = std::max(rank_after, transfer.time(successor.bytes) + plan->rank[successor.node]);
      chain_after = std::max(chain_after, chain[successor.node]);
    }
    plan->rank[*node] = times[*node].mean + rank_after;
    chain[*node] = times[*node].fastest + chain_after;
    plan->critical_path = std::max(plan->critical_path, chain[*node]);
  }
  std::stable_sort(by_rank.begin(), by_rank.end(),
                   [plan](uint32_t a, uint32_t b) { return plan->rank[a] > plan->rank[b]; });
}

/// Nodes too short for their start time to tell finish where they start: such a node comes before what starts with it,
/// and the stable sort keeps predecessors in front.
void InnerCoreScheduler::Workspace::finishPlan(DagPlan* plan) const
{
  for (const uint32_t node : by_rank)
  {
    plan->order[plan->unit[node]].push_back(node);
    plan->makespan = std::max(plan->makespan, plan->finish[node]);
  }
  const auto time = [plan](uint32_t node) { return std::pair(plan->start[node], plan->finish[node]); };
  for (std::vector<uint32_t>& order : plan->order)
  {
    std::stable_sort(order.begin(), order.end(), [&time](uint32_t a, uint32_t b) { return time(a) < time(b); });
  }
}

InnerCoreScheduler::InnerCoreScheduler(const InnerCoreOptions& options)
  : options_(options), workspace_(std::make_unique<Workspace>())
{
}

InnerCoreScheduler::~InnerCoreScheduler() = default;
InnerCoreScheduler::InnerCoreScheduler(InnerCoreScheduler&&) noexcept = default;
InnerCoreScheduler& InnerCoreScheduler::operator=(InnerCoreScheduler&&) noexcept = default;

void InnerCoreScheduler::schedule(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                                  const StartTimes& start_times, DagPlan* plan)
{
  checkSizes(graph, etc, transfers);
  etc.validate();
  checkTimes("available", start_times.available, etc.units());
  checkTimes("release", start_times.release, graph.nodes());
  Workspace& work = *workspace_;
  work.clearPlan(graph, etc, plan);
  if (!plan->feasible())
  {
    return;
  }
  work.rankNodes(graph, transfers.mean(), plan);
  work.placement.begin(graph, etc, transfers, start_times, options_.insertion, plan);
  switch (options_.policy)
  {
    case InnerCorePolicy::LEVELS:
      work.levels.map(work.by_rank, options_.level_mapping, options_.level_barrier, &work.placement);
      break;
    case InnerCorePolicy::HEFT:
      for (const uint32_t node : work.by_rank)
      {
        work.placement.commit(node, work.placement.earliest(node));
      }
      break;
    case InnerCorePolicy::LOOKAHEAD:
      work.lookahead.map(work.by_rank, &work.placement);
      break;
  }
  work.finishPlan(plan);
}

DagPlan InnerCoreScheduler::schedule(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                                     const StartTimes& start_times)
{
  DagPlan plan;
  schedule(graph, etc, transfers, start_times, &plan);
  return plan;
}

}  // namespace pi_runtime
