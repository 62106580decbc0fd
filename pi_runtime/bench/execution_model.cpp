#include "execution_model.h"

#include <algorithm>
#include <cstdint>
#include <deque>
#include <vector>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::INF;

struct Unit
{
  std::deque<uint32_t> queue;
  double free_at = 0.0;           ///< when the running task is really done; infinite: idle
  double expected_free_at = 0.0;  ///< by the believed time of the running task
  double waiting = 0.0;           ///< believed time of the tasks in the queue
};

class Execution
{
public:
  Execution(const pi_runtime::EtcMatrix& etc, const pi_runtime::EtcMatrix& actual,
            const pi_runtime::Assignment& assignment)
    : etc_(etc), actual_(actual), units_(etc.units())
  {
    for (uint32_t task : assignment.order)
    {
      const auto unit = static_cast<size_t>(assignment.unit[task]);
      units_[unit].queue.push_back(task);
      units_[unit].waiting += etc.at(task, unit);
    }
  }

  double run(bool stealing)
  {
    double makespan = 0.0;
    while (true)
    {
      const auto next = std::min_element(units_.begin(), units_.end(),
                                         [](const Unit& a, const Unit& b) { return a.free_at < b.free_at; });
      if (next->free_at == INF)
      {
        return makespan;
      }
      makespan = std::max(makespan, next->free_at);
      next->free_at = INF;
      for (size_t unit = 0; unit < units_.size(); ++unit)  // whoever is idle, now or since earlier
      {
        if (units_[unit].free_at == INF && !units_[unit].queue.empty())
        {
          start(unit, unit, 0, makespan);
        }
        else if (units_[unit].free_at == INF && stealing)
        {
          steal(unit, makespan);
        }
      }
    }
  }

private:
  void start(size_t unit, size_t queue_of, size_t place, double now)
  {
    Unit& owner = units_[queue_of];
    const uint32_t task = owner.queue[place];
    owner.queue.erase(owner.queue.begin() + static_cast<std::ptrdiff_t>(place));
    owner.waiting -= etc_.at(task, queue_of);
    units_[unit].expected_free_at = now + etc_.at(task, unit);
    units_[unit].free_at = now + actual_.at(task, unit);
  }

  /// Starts the waiting task of another unit that helps that unit most, if there is one.
  void steal(size_t thief, double now)
  {
    double best_gain = 0.0;
    size_t best_victim = 0;
    size_t best_place = 0;
    for (size_t victim = 0; victim < units_.size(); ++victim)
    {
      const Unit& unit = units_[victim];
      const double end = std::max(now, unit.expected_free_at) + unit.waiting;
      for (size_t place = 0; place < unit.queue.size(); ++place)
      {
        const uint32_t task = unit.queue[place];
        const double gain = end - std::max(now + etc_.at(task, thief), end - etc_.at(task, victim));
        if (gain > best_gain)
        {
          best_gain = gain;
          best_victim = victim;
          best_place = place;
        }
      }
    }
    if (best_gain > 0.0)
    {
      start(thief, best_victim, best_place, now);
    }
  }

  const pi_runtime::EtcMatrix& etc_;
  const pi_runtime::EtcMatrix& actual_;
  std::vector<Unit> units_;
};

}  // namespace

double actualMakespan(const pi_runtime::EtcMatrix& etc, const pi_runtime::EtcMatrix& actual,
                      const pi_runtime::Assignment& assignment, bool stealing)
{
  return Execution(etc, actual, assignment).run(stealing);
}

}  // namespace pi_runtime_bench
