#include "textbook_heft.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <vector>

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::EtcMatrix;
using pi_runtime::TaskGraph;
using pi_runtime::TransferModel;

double meanTime(const EtcMatrix& etc, uint32_t node)
{
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t unit = 0; unit < etc.units(); ++unit)
  {
    if (std::isfinite(etc.at(node, unit)))
    {
      sum += etc.at(node, unit);
      count += 1.0;
    }
  }
  return sum / count;
}

double meanTransfer(const TransferModel& transfers, double bytes)
{
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t from = 0; from < transfers.units(); ++from)
  {
    for (std::size_t to = 0; to < transfers.units(); ++to)
    {
      if (from != to)
      {
        sum += transfers.time(from, to, bytes);
        count += 1.0;
      }
    }
  }
  return count > 0.0 ? sum / count : 0.0;
}

/// Eq. 5, by recursion. @param ranks  NaN where not yet known.
double upwardRank(uint32_t node, const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
                  std::vector<double>* ranks)
{
  double& rank = (*ranks)[node];
  if (std::isnan(rank))
  {
    double after = 0.0;
    for (const TaskGraph::Link& link : graph.successors(node))
    {
      after =
          std::max(after, meanTransfer(transfers, link.bytes) + upwardRank(link.node, graph, etc, transfers, ranks));
    }
    rank = meanTime(etc, node) + after;
  }
  return rank;
}

/// Step 1: all nodes by falling upward rank.
std::vector<uint32_t> priorityList(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
{
  std::vector<double> ranks(graph.nodes(), std::numeric_limits<double>::quiet_NaN());
  for (uint32_t node = 0; node < graph.nodes(); ++node)
  {
    upwardRank(node, graph, etc, transfers, &ranks);
  }
  std::vector<uint32_t> list = graph.topologicalOrder();
  std::stable_sort(list.begin(), list.end(), [&](uint32_t a, uint32_t b) { return ranks[a] > ranks[b]; });
  return list;
}

/// A schedule under construction, cheap to write and dear to use: it may be copied to try something.
class Schedule
{
public:
  Schedule(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
    : graph_(&graph)
    , etc_(&etc)
    , transfers_(&transfers)
    , bookings_(etc.units())
    , unit_(graph.nodes(), NOWHERE)
    , finish_(graph.nodes(), 0.0)
  {
  }

  struct Booking
  {
    double start;
    double finish;
  };

  /// Where a node would go on a unit; finish = +infinity if that cannot run it. Predecessors not yet placed do not
  /// count.
  Booking earliest(uint32_t node, std::size_t unit) const
  {
    double ready = 0.0;
    for (const TaskGraph::Link& link : graph_->predecessors(node))
    {
      if (unit_[link.node] != NOWHERE)
      {
        ready = std::max(ready, finish_[link.node] + transfers_->time(unit_[link.node], unit, link.bytes));
      }
    }
    const double duration = etc_->at(node, unit);
    const double start = std::isinf(duration) ? ready : earliestStart(unit, ready, duration);
    return {start, start + duration};
  }

  std::size_t bestUnit(uint32_t node) const
  {
    std::size_t best = 0;
    for (std::size_t unit = 1; unit < bookings_.size(); ++unit)
    {
      best = earliest(node, unit).finish < earliest(node, best).finish ? unit : best;
    }
    return best;
  }

  /// @return finish.
  double place(uint32_t node, std::size_t unit)
  {
    const Booking booking = earliest(node, unit);
    bookings_[unit].push_back(booking);
    unit_[node] = unit;
    finish_[node] = booking.finish;
    return booking.finish;
  }

  double makespan() const { return finish_.empty() ? 0.0 : *std::max_element(finish_.begin(), finish_.end()); }

private:
  static constexpr std::size_t NOWHERE = std::numeric_limits<std::size_t>::max();

  /// Between the bookings of the unit: at `ready` itself or at the end of a booking.
  double earliestStart(std::size_t unit, double ready, double duration) const
  {
    double best = std::numeric_limits<double>::infinity();
    const auto consider = [&](double start)
    {
      const auto free = [&](const Booking& booking)
      { return start + duration <= booking.start || booking.finish <= start; };
      if (start >= ready && std::all_of(bookings_[unit].begin(), bookings_[unit].end(), free))
      {
        best = std::min(best, start);
      }
    };
    consider(ready);
    for (const Booking& booking : bookings_[unit])
    {
      consider(booking.finish);
    }
    return best;
  }

  const TaskGraph* graph_;
  const EtcMatrix* etc_;
  const TransferModel* transfers_;
  std::vector<std::vector<Booking>> bookings_;  // per unit
  std::vector<std::size_t> unit_;               // per node
  std::vector<double> finish_;                  // per node [s]
};

/// Latest finish of the children of a node, placed in the order of the list after the node was tried on a unit.
double tryChildren(uint32_t node, std::size_t unit, const TaskGraph& graph, const std::vector<uint32_t>& list,
                   Schedule schedule)
{
  schedule.place(node, unit);
  double last = 0.0;
  for (const uint32_t child : list)
  {
    const TaskGraph::Links links = graph.successors(node);
    if (std::any_of(links.begin(), links.end(), [&](const TaskGraph::Link& link) { return link.node == child; }))
    {
      last = std::max(last, schedule.place(child, schedule.bestUnit(child)));
    }
  }
  return last;
}

}  // namespace

double textbookHeft(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
{
  Schedule schedule(graph, etc, transfers);
  for (const uint32_t node : priorityList(graph, etc, transfers))
  {
    schedule.place(node, schedule.bestUnit(node));
  }
  return schedule.makespan();
}

double textbookLookahead(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers)
{
  const std::vector<uint32_t> list = priorityList(graph, etc, transfers);
  Schedule schedule(graph, etc, transfers);
  for (const uint32_t node : list)
  {
    using Outcome = std::tuple<double, double, std::size_t>;  // finish of the last child, own finish, unit
    constexpr double INFINITE = std::numeric_limits<double>::infinity();
    Outcome best(INFINITE, INFINITE, 0);
    for (std::size_t unit = 0; unit < etc.units(); ++unit)
    {
      const double finish = schedule.earliest(node, unit).finish;
      if (std::isfinite(finish))
      {
        best = std::min(best, Outcome(tryChildren(node, unit, graph, list, schedule), finish, unit));
      }
    }
    schedule.place(node, std::get<2>(best));
  }
  return schedule.makespan();
}

}  // namespace pi_runtime_bench
