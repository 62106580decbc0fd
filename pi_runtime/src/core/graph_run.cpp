// RuntimeCore: tasks that depend on each other.
#include <pi_node/durations.h>
#include <algorithm>

#include "core/runtime_core.h"
#include "scheduler/inter_core_problem.h"

namespace pi_runtime
{
std::vector<TaskHandle> RuntimeCore::submitGraph(GraphRequest request)
{
  std::vector<TaskGraph::Edge> edges;
  for (const GraphRequest::Edge& edge : request.edges)
  {
    edges.push_back(TaskGraph::Edge{edge.from, edge.to, edge.bytes});
  }
  const TaskGraph structure(static_cast<uint32_t>(request.tasks.size()), edges);
  std::vector<TaskHandle> handles;
  auto graph = std::make_shared<GraphState>();
  for (TaskRequest& task : request.tasks)
  {
    graph->tasks.push_back(makeTask(std::move(task)));
    handles.push_back(TaskHandle(graph->tasks.back()));
  }
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  std::vector<TaskPtr> refused;
  for (uint32_t node = 0; node < structure.nodes(); ++node)
  {
    TaskState& task = *graph->tasks[node];
    graph->waiting_for.push_back(static_cast<uint32_t>(structure.predecessors(node).size()));
    graph->successors.emplace_back();
    for (const TaskGraph::Link& link : structure.successors(node))
    {
      graph->successors.back().push_back(link.node);
    }
    if (!enroll(task, &ended))
    {
      refused.push_back(graph->tasks[node]);
    }
    task.graph = graph;
    task.node = node;
  }
  planGraph(lock, *graph, structure);
  for (const TaskPtr& task : refused)
  {
    endGraphNode(*task, &ended);
  }
  for (uint32_t node = 0; node < structure.nodes(); ++node)
  {
    if (graph->waiting_for[node] == 0)
    {
      release(*graph, node, &ended);
    }
  }
  pumpAll(lock, Caller::SUBMITTER);
  leave(lock, ended);
  return handles;
}

void RuntimeCore::planGraph(Lock& lock, GraphState& graph, const TaskGraph& structure)
{
  const size_t nodes = structure.nodes();
  EtcMatrix etc(nodes, units_.size());
  StartTimes start_times;
  const int64_t now = pi_node::monotonicNs();
  bool feasible = nodes != 0;
  for (size_t node = 0; node < nodes; ++node)
  {
    bool any = false;
    for (const std::unique_ptr<Unit>& unit : units_)
    {
      const TaskState& task = *graph.tasks[node];
      const Cost cost = task.phase == TaskState::Phase::NEW ? costOn(task, *unit) : Cost();
      etc.at(node, unit->index) = cost.allowed ? cost.plan_s : INF;
      any = any || cost.allowed;
    }
    feasible = feasible && any;
  }
  TransferModel transfers(units_.size());
  for (const std::unique_ptr<Unit>& from : units_)
  {
    start_times.available.push_back(readyIn(*from, now, nullptr));
    for (const std::unique_ptr<Unit>& to : units_)
    {
      const double bandwidth = std::min(from->executors.front().bandwidth_bps, to->executors.front().bandwidth_bps);
      if (from != to && bandwidth < INF)
      {
        transfers.setLink(from->index, to->index, TransferLink{0.0, bandwidth});
      }
    }
  }
  const InnerCoreOptions options = inner_core_;
  graph.planned.assign(nodes, nullptr);
  if (options.policy == InnerCorePolicy::LEVELS && options.level_barrier)
  {
    raiseBarriers(graph, structure);
  }
  DagPlan plan;
  if (feasible)
  {
    lock.unlock();
    InnerCoreScheduler(options).schedule(structure, etc, transfers, start_times, &plan);
    lock.lock();
  }
  std::vector<uint32_t> order(structure.topologicalOrder());
  if (feasible)
  {
    std::stable_sort(order.begin(), order.end(),
                     [&plan](uint32_t a, uint32_t b) { return plan.start[a] < plan.start[b]; });
    for (size_t node = 0; node < nodes; ++node)
    {
      graph.planned[node] = units_[plan.unit[node]].get();
    }
  }
  for (const uint32_t node : order)
  {
    // One that is queued or has ended already was cancelled, or released by that, during the planning.
    if (graph.tasks[node]->phase == TaskState::Phase::NEW)
    {
      graph.tasks[node]->sequence = next_sequence_++;
    }
  }
}

void RuntimeCore::raiseBarriers(GraphState& graph, const TaskGraph& structure)
{
  graph.levels.resize(structure.levels());
  for (uint32_t node = 0; node < structure.nodes(); ++node)
  {
    const uint32_t level = structure.level(node);
    graph.level_of.push_back(level);
    graph.levels[level].push_back(node);
    graph.waiting_for[node] += level > 0 ? 1 : 0;
  }
  for (const std::vector<uint32_t>& level : graph.levels)
  {
    graph.level_left.push_back(static_cast<uint32_t>(level.size()));
  }
}

void RuntimeCore::release(GraphState& graph, uint32_t node, std::vector<TaskPtr>* ended)
{
  TaskState& task = *graph.tasks[node];
  if (task.phase != TaskState::Phase::NEW)
  {
    return;
  }
  Unit* const unit = graph.planned[node];
  const Cost cost = unit != nullptr ? costOn(task, *unit) : Cost();
  if (cost.allowed && !stopping_)
  {
    assign(task, *unit, cost);
  }
  else
  {
    place(task, ended);
  }
}

void RuntimeCore::endGraphNode(TaskState& task, std::vector<TaskPtr>* ended)
{
  const std::shared_ptr<GraphState> graph = task.graph;
  graph->unsettled.push_back(task.node);
  if (graph->settling)
  {
    return;  // ended by the loop below: no recursion, however long the chain
  }
  graph->settling = true;
  while (!graph->unsettled.empty())
  {
    const uint32_t node = graph->unsettled.back();
    graph->unsettled.pop_back();
    settle(*graph, node, ended);
    graph->tasks[node]->graph.reset();  // the graph has its tasks, and goes with the last one that needs it
  }
  graph->settling = false;
}

void RuntimeCore::settle(GraphState& graph, uint32_t node, std::vector<TaskPtr>* ended)
{
  const Outcome outcome = graph.tasks[node]->result.outcome;
  std::vector<uint32_t> free;
  const auto arrived = [&](uint32_t next)
  {
    if (--graph.waiting_for[next] == 0)
    {
      free.push_back(next);
    }
  };
  for (const uint32_t next : graph.successors[node])
  {
    TaskState& successor = *graph.tasks[next];
    if (outcome == Outcome::OK)
    {
      arrived(next);
    }
    else if (successor.phase == TaskState::Phase::NEW)
    {
      end(successor, Outcome::CANCELLED,
          "sub-task " + std::to_string(node) + ", which it depends on, ended: " + toString(outcome), ended);
    }
  }
  if (!graph.levels.empty())
  {
    const uint32_t level = graph.level_of[node];
    if (--graph.level_left[level] == 0 && level + 1 < graph.levels.size())
    {
      std::for_each(graph.levels[level + 1].begin(), graph.levels[level + 1].end(), arrived);
    }
  }
  for (const uint32_t next : free)
  {
    release(graph, next, ended);
  }
}

}  // namespace pi_runtime
