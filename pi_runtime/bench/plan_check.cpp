#include "plan_check.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_runtime
{
namespace
{

using Finding = std::optional<std::string>;

std::string named(const char* kind, std::size_t number)
{
  return kind + std::to_string(number);
}
std::string seconds(double time)
{
  return std::to_string(time) + " s";
}

/// One check of a whole plan; each method looks at one property and expects the ones before it to hold.
class PlanCheck
{
public:
  PlanCheck(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers, const DagPlan& plan,
            const StartTimes& start_times)
    : graph_(graph), etc_(etc), transfers_(transfers), plan_(plan), start_times_(start_times)
  {
  }

  Finding sizes() const
  {
    const std::size_t nodes = graph_.nodes();
    if (plan_.unit.size() != nodes || plan_.start.size() != nodes || plan_.finish.size() != nodes ||
        plan_.level.size() != nodes || plan_.rank.size() != nodes || plan_.order.size() != etc_.units() ||
        etc_.tasks() != nodes || transfers_.units() != etc_.units())
    {
      return "the sizes of graph, ETC matrix, transfer model and plan do not agree";
    }
    return {};
  }

  Finding infeasibleNodes() const
  {
    std::vector<uint32_t> expected;
    for (uint32_t node = 0; node < graph_.nodes(); ++node)
    {
      bool runnable = false;
      for (std::size_t unit = 0; unit < etc_.units(); ++unit)
      {
        runnable = runnable || std::isfinite(etc_.at(node, unit));
      }
      if (!runnable)
      {
        expected.push_back(node);
      }
    }
    return plan_.infeasible == expected ? Finding() : "infeasible does not list the nodes that no unit can run";
  }

  Finding nothingPlanned() const
  {
    const auto zero = [](double time) { return time == 0.0; };
    const bool nothing =
        std::all_of(plan_.unit.begin(), plan_.unit.end(), [](uint32_t unit) { return unit == DagPlan::NO_UNIT; }) &&
        std::all_of(plan_.start.begin(), plan_.start.end(), zero) &&
        std::all_of(plan_.finish.begin(), plan_.finish.end(), zero) &&
        std::all_of(plan_.order.begin(), plan_.order.end(),
                    [](const std::vector<uint32_t>& order) { return order.empty(); }) &&
        plan_.makespan == 0.0;
    return nothing ? Finding() : "an infeasible plan must not plan anything";
  }

  /// Makespan and the tolerance that goes with it.
  Finding makespan()
  {
    const double latest = plan_.finish.empty() ? 0.0 : *std::max_element(plan_.finish.begin(), plan_.finish.end());
    tolerance_ = 1e-9 * std::abs(latest);
    return same(plan_.makespan, latest) ? Finding() : "makespan is not the latest finish";
  }

  Finding nodeTimes() const
  {
    for (uint32_t node = 0; node < graph_.nodes(); ++node)
    {
      const uint32_t unit = plan_.unit[node];
      if (unit >= etc_.units())
      {
        return named("node ", node) + " has no unit";
      }
      const double duration = etc_.at(node, unit);
      if (!std::isfinite(duration))
      {
        return named("node ", node) + named(" is on unit ", unit) + ", which cannot run it";
      }
      if (!same(plan_.finish[node], plan_.start[node] + duration))
      {
        return named("node ", node) + " does not run for its " + seconds(duration);
      }
      const double available = start_times_.available.empty() ? 0.0 : start_times_.available[unit];
      const double release = start_times_.release.empty() ? 0.0 : start_times_.release[node];
      if (before(plan_.start[node], available) || before(plan_.start[node], release))
      {
        return named("node ", node) + " starts before its unit is available or its data are released";
      }
      if (plan_.level[node] != graph_.level(node))
      {
        return named("node ", node) + " has the wrong level";
      }
    }
    return {};
  }

  Finding precedence() const
  {
    for (uint32_t node = 0; node < graph_.nodes(); ++node)
    {
      for (const TaskGraph::Link& link : graph_.predecessors(node))
      {
        const double arrival =
            plan_.finish[link.node] + transfers_.time(plan_.unit[link.node], plan_.unit[node], link.bytes);
        if (before(plan_.start[node], arrival))
        {
          return named("node ", node) + " starts at " + seconds(plan_.start[node]) +
                 named(", before it has the data of node ", link.node) + " at " + seconds(arrival);
        }
      }
    }
    return {};
  }

  Finding unitOrders() const
  {
    std::vector<bool> listed(graph_.nodes(), false);
    std::size_t count = 0;
    for (uint32_t unit = 0; unit < etc_.units(); ++unit)
    {
      double free = -std::numeric_limits<double>::infinity();
      for (const uint32_t node : plan_.order[unit])
      {
        if (node >= graph_.nodes() || listed[node] || plan_.unit[node] != unit)
        {
          return named("the order of unit ", unit) + named(" wrongly lists node ", node);
        }
        if (before(plan_.start[node], free))
        {
          return named("node ", node) + named(" starts while unit ", unit) + " still runs the node listed before it";
        }
        listed[node] = true;
        free = plan_.finish[node];
        ++count;
      }
    }
    return count == graph_.nodes() ? Finding() : "not every node is in the order of its unit";
  }

  Finding barriers() const
  {
    double above = 0.0;  // latest finish of the levels above
    double latest = 0.0;
    uint32_t level = 0;
    for (const uint32_t node : graph_.topologicalOrder())  // goes level by level
    {
      if (graph_.level(node) != level)
      {
        level = graph_.level(node);
        above = latest;
      }
      if (before(plan_.start[node], above))
      {
        return named("node ", node) + " starts before all levels above its own are done";
      }
      latest = std::max(latest, plan_.finish[node]);
    }
    return {};
  }

private:
  bool before(double time, double bound) const { return !(time >= bound - tolerance_); }  // true for NaN
  bool same(double a, double b) const { return std::abs(a - b) <= tolerance_; }

  const TaskGraph& graph_;
  const EtcMatrix& etc_;
  const TransferModel& transfers_;
  const DagPlan& plan_;
  const StartTimes& start_times_;
  double tolerance_ = 0.0;  // [s]
};

}  // namespace

std::optional<std::string> validatePlan(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                                        const DagPlan& plan, const StartTimes& start_times, bool barrier)
{
  PlanCheck check(graph, etc, transfers, plan, start_times);
  Finding finding = check.sizes();
  finding = finding ? finding : check.infeasibleNodes();
  if (finding || !plan.feasible())
  {
    return finding ? finding : check.nothingPlanned();
  }
  finding = check.makespan();
  finding = finding ? finding : check.nodeTimes();
  finding = finding ? finding : check.precedence();
  finding = finding ? finding : check.unitOrders();
  return finding || !barrier ? finding : check.barriers();
}

double communicationToComputation(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
{
  if (graph.edges() == 0)
  {
    return 0.0;
  }
  const TransferModel::Mean mean = transfers.mean();
  double communication = 0.0;
  double computation = 0.0;
  int runnable = 0;
  for (uint32_t node = 0; node < graph.nodes(); ++node)
  {
    for (const TaskGraph::Link& successor : graph.successors(node))
    {
      communication += mean.time(successor.bytes);
    }
    double sum = 0.0;
    int units = 0;
    for (size_t unit = 0; unit < etc.units(); ++unit)
    {
      const bool possible = std::isfinite(etc.at(node, unit));
      sum += possible ? etc.at(node, unit) : 0.0;
      units += possible;
    }
    computation += units > 0 ? sum / units : 0.0;
    runnable += units > 0;
  }
  communication /= static_cast<double>(graph.edges());
  return communication == 0.0 ? 0.0 : communication / (computation / runnable);
}

InnerCorePolicy recommendedPolicy(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
{
  return communicationToComputation(graph, etc, transfers) >= 1.0 ? InnerCorePolicy::LOOKAHEAD : InnerCorePolicy::HEFT;
}

}  // namespace pi_runtime
