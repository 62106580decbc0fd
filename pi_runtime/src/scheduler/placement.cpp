// RuntimeCore: placement of tasks on units.
#include <pi_node/durations.h>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "core/runtime_core.h"
#include "scheduler/inter_core_problem.h"

namespace pi_runtime
{
namespace
{

/// Assumed run time of an unknown codelet.
constexpr double UNKNOWN_S = 1e-3;
/// A stolen task must end earlier by this and by a tenth of its run time.
constexpr double LEAST_GAIN_S = 20e-6;
constexpr int MOST_STEAL_LOOKS = 64;
constexpr double LOOK_AGAIN_S = 500e-6;

}  // namespace

double RuntimeCore::leastPiece(const TaskState& task, const Cost& cost)
{
  const double run_s = cost.run_s > 0.0 ? cost.run_s : UNKNOWN_S;
  const Codelet& codelet = *task.request.codelet;
  if (!codelet.sliceable)
  {
    return run_s;
  }
  return run_s *
         std::min(1.0, static_cast<double>(codelet.slice_granularity) / static_cast<double>(task.request.range));
}

RuntimeCore::Cost RuntimeCore::executorCost(const TaskState& task, Unit& unit, size_t index) const
{
  Cost cost;
  const UnitExecutor& entry = unit.executors[index];
  if (!canRun(entry, *task.record))
  {
    return cost;
  }
  cost.possible = true;
  cost.executor = static_cast<int>(index);
  const EtcTable::Estimate estimate = task.record->row->predict(task.bucket, entry.column);
  cost.run_s = estimate.known ? estimate.seconds : 0.0;
  cost.measured = estimate.measured;
  const double run_s = estimate.known ? estimate.seconds : UNKNOWN_S;
  const double share = static_cast<double>(task.left()) / static_cast<double>(task.request.range);
  double moved = 0.0;
  for (size_t i = 0; separate_memory_ && i < task.request.arguments.size(); ++i)
  {
    const Argument& argument = task.request.arguments[i];
    if (argument.isBuffer())
    {
      // Later slices need what earlier ones wrote, as Execution::accessOf().
      const Access access = task.next != 0 && writes(argument.access()) ? Access::READ_WRITE : argument.access();
      moved += static_cast<double>(argument.buffer()->bytesToMove(entry.executor->memory(), access));
    }
  }
  cost.plan_s = std::max(run_s * share + (moved > 0.0 ? moved / std::min(entry.bandwidth_bps, 1e12) : 0.0), 1e-9);
  cost.energy_j = cost.plan_s * unit.tuning.active_power_w;
  return cost;
}

RuntimeCore::Cost RuntimeCore::costOn(const TaskState& task, Unit& unit) const
{
  Cost best;
  if (!unit.usable() || (!task.request.unit.empty() && task.request.unit != unit.name))
  {
    return best;
  }
  for (size_t index = 0; index < unit.executors.size(); ++index)
  {
    if (task.pinned_executor != TaskState::ANY_EXECUTOR && static_cast<size_t>(task.pinned_executor) != index)
    {
      continue;
    }
    if (task.pinned_executor == TaskState::ANY_EXECUTOR && isUntried(unit.executors[index], *task.record) &&
        hasTriedExecutor(task))
    {
      continue;
    }
    const Cost cost = executorCost(task, unit, index);
    if (cost.possible && (!best.possible || cost.plan_s < best.plan_s))
    {
      best = cost;
    }
  }
  best.allowed = best.possible && withinBudget(task, unit, best);
  return best;
}

bool RuntimeCore::hasTriedExecutor(const TaskState& task) const
{
  return std::any_of(units_.begin(), units_.end(),
                     [&task](const std::unique_ptr<Unit>& unit)
                     {
                       return unit->usable() && (task.request.unit.empty() || task.request.unit == unit->name) &&
                              std::any_of(unit->executors.begin(), unit->executors.end(),
                                          [&task](const UnitExecutor& entry)
                                          { return canRun(entry, *task.record) && !isUntried(entry, *task.record); });
                     });
}

double RuntimeCore::blockingBudget(const Unit& unit) const
{
  return std::min(unit.blocking_budget_s, unit.others_budget_s);
}

bool RuntimeCore::supports(const Unit& unit, const TaskState& task) const
{
  return (task.request.unit.empty() || task.request.unit == unit.name) &&
         std::any_of(unit.executors.begin(), unit.executors.end(),
                     [&](const UnitExecutor& entry) { return canRun(entry, *task.record); });
}

bool RuntimeCore::withinBudget(const TaskState& task, const Unit& unit, const Cost& cost) const
{
  double budget = blockingBudget(unit);
  const auto stream = streams_.find(task.request.stream);
  if (stream != streams_.end() && stream->second.unit == &unit)
  {
    budget = unit.others_budget_s;  // its own place was part of the admission test
  }
  if (budget == INF || task.calibration)
  {
    return true;
  }
  // Unknown run time: prefer a unit without streams; if there is none, count UNKNOWN_S.
  const bool unknown = cost.run_s == 0.0 && !task.request.codelet->sliceable;
  if (unknown && std::any_of(units_.begin(), units_.end(),
                             [&](const std::unique_ptr<Unit>& other)
                             { return other->usable() && blockingBudget(*other) == INF && supports(*other, task); }))
  {
    return false;
  }
  double piece_s = leastPiece(task, cost);
  if (stream != streams_.end() && stream->second.request.piece.count() > 0)
  {
    piece_s = std::min(piece_s, std::chrono::duration<double>(stream->second.request.piece).count());
  }
  return piece_s <= budget;
}

double RuntimeCore::runningLeft(const Unit& unit, int64_t now) const
{
  double left = 0.0;
  for (const TaskPtr& task : unit.running)
  {
    if (&task == &unit.running.front())
    {
      const double elapsed = pi_node::seconds(now - std::max(task->started_ns, unit.last_end_ns));
      // A late task is expected to need as much time again as it is late.
      left += std::abs(task->expected_s - elapsed);
    }
    else
    {
      left += task->expected_s;
    }
  }
  return left;
}

double RuntimeCore::readyIn(const Unit& unit, int64_t now, const TaskState* before) const
{
  double ready = runningLeft(unit, now);
  if (before == nullptr)
  {
    return ready + unit.queued_s;
  }
  const TaskOrder order = unit.queue.key_comp();
  for (const TaskState* queued : unit.queue)
  {
    if (!order(queued, before))
    {
      break;
    }
    ready += queued->expected_s;
  }
  return ready;
}

Unit* RuntimeCore::chooseForDeadline(const TaskState& task, const std::vector<Cost>& costs, int64_t now) const
{
  const auto finish = [&](const Unit& unit) { return readyIn(unit, now, &task) + costs[unit.index].plan_s; };
  const auto stream = streams_.find(task.request.stream);
  if (stream != streams_.end())
  {
    Unit* const home = stream->second.unit;
    const double left = pi_node::seconds(task.deadline_ns - now);
    if (home != nullptr && costs[home->index].allowed && finish(*home) <= left)
    {
      return home;
    }
  }
  Unit* best = nullptr;
  double best_finish = INF;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (costs[unit->index].allowed && finish(*unit) < best_finish)
    {
      best = unit.get();
      best_finish = finish(*unit);
    }
  }
  return best;
}

Unit* RuntimeCore::choose(TaskState& task, Cost* cost, TaskResult* refusal)
{
  costs_.resize(units_.size());
  const int64_t now = pi_node::monotonicNs();
  bool any = false;
  single_etc_.resize(1, units_.size());
  single_energy_.resize(1, units_.size());
  single_available_.resize(units_.size());
  if (task.realTime() && task.sequence == 0)
  {
    task.sequence = next_sequence_++;  // its place in queues has to be known
  }
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    const size_t u = unit->index;
    costs_[u] = costOn(task, *unit);
    any = any || costs_[u].allowed;
    single_etc_.at(0, u) = costs_[u].allowed ? costs_[u].plan_s : INF;
    single_energy_.at(0, u) = costs_[u].energy_j;
    single_available_[u] = readyIn(*unit, now, nullptr);
  }
  if (!any)
  {
    *refusal = refusalOf(task, costs_);
    return nullptr;
  }
  Unit* chosen = nullptr;
  if (task.realTime())
  {
    chosen = chooseForDeadline(task, costs_, now);
  }
  else
  {
    single_scheduler_.schedule(single_etc_, single_available_, inter_core_,
                               inter_core_.gamma > 0.0 ? &single_energy_ : nullptr, &single_assignment_);
    chosen = units_[static_cast<size_t>(single_assignment_.unit[0])].get();
  }
  *cost = costs_[chosen->index];
  return chosen;
}

TaskResult RuntimeCore::refusalOf(const TaskState& task, const std::vector<Cost>& costs) const
{
  TaskResult result;
  result.outcome = Outcome::REFUSED;
  const TaskRequest& request = task.request;
  const TaskResult* blocked = nullptr;
  std::string failed;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (!request.unit.empty() && request.unit != unit->name)
    {
      continue;
    }
    const Cost& cost = costs[unit->index];
    if (cost.possible)
    {
      result.message += (result.message.empty() ? "" : ", ") + unit->name + " for " +
                        milliseconds(leastPiece(task, cost)) + " where they stand " +
                        milliseconds(blockingBudget(*unit));
    }
    for (const UnitExecutor& entry : unit->executors)
    {
      if (!entry.executor->supports(*request.codelet))
      {
        continue;
      }
      const CodeletRecord::Column& column = task.record->at(entry.column);
      if (column.blocked)
      {
        blocked = &column.reason;
      }
      else if (!unit->usable())
      {
        failed += (failed.empty() ? "" : ", ") + unit->name + " is out: " + unit->whyOut();
      }
    }
  }
  if (!result.message.empty())
  {
    result.message = "it would delay admitted streams (" + result.message + "); " +
                     (request.codelet->sliceable ? "make slice_granularity smaller" : "make the codelet sliceable") +
                     ", add a unit or retire a stream";
  }
  else if (blocked != nullptr)
  {
    result.outcome = blocked->outcome;
    result.opencl_code = blocked->opencl_code;
    result.message = blocked->message;
  }
  else if (!failed.empty())
  {
    result.outcome = Outcome::UNIT_FAILED;
    result.message = "no unit is left that can run it; " + failed;
  }
  else
  {
    result.message = "no unit can run any of its implementations";
  }
  return result;
}

void RuntimeCore::assign(TaskState& task, Unit& unit, const Cost& cost)
{
  if (task.next != 0 && task.unit != nullptr && task.unit != &unit)
  {
    task.moved = true;
  }
  if (task.sequence == 0)
  {
    task.sequence = next_sequence_++;
  }
  if (task.queued_ns == 0)
  {
    task.queued_ns = pi_node::monotonicNs();
  }
  task.executor = cost.executor;
  task.run_s = cost.run_s;
  task.measured = cost.measured;
  task.expected_s = cost.plan_s;
  unit.push(task);
}

Unit* RuntimeCore::laneOf(const TaskState& task) const
{
  const auto stream = streams_.find(task.request.stream);
  Unit* const home = stream != streams_.end() ? stream->second.unit : nullptr;
  return home != nullptr && home->base != nullptr && home->usable() && task.request.unit.empty() &&
                 canRun(home->executors.front(), *task.record)
             ? home
             : nullptr;
}

Unit* RuntimeCore::place(TaskState& task, std::vector<TaskPtr>* ended)
{
  if (stopping_)
  {
    end(task, Outcome::SHUT_DOWN, "the runtime ended before it began", ended);
    return nullptr;
  }
  Cost cost;
  if (Unit* const lane = laneOf(task))
  {
    cost = executorCost(task, *lane, 0);
    assign(task, *lane, cost);
    return lane;
  }
  TaskResult refusal;
  Unit* const unit = choose(task, &cost, &refusal);
  if (unit == nullptr)
  {
    task.result.opencl_code = refusal.opencl_code;
    end(task, refusal.outcome, refusal.message, ended);
    return nullptr;
  }
  assign(task, *unit, cost);
  return unit;
}

void RuntimeCore::placeBatch(Lock& lock, const std::vector<TaskPtr>& batch, std::vector<TaskPtr>* ended)
{
  std::vector<TaskPtr> planned;
  std::vector<TaskPtr> urgent;
  for (const TaskPtr& task : batch)
  {
    (task->realTime() ? urgent : planned).push_back(task);
  }
  std::stable_sort(urgent.begin(), urgent.end(),
                   [](const TaskPtr& a, const TaskPtr& b) { return a->deadline_ns < b->deadline_ns; });
  for (const TaskPtr& task : urgent)
  {
    place(*task, ended);
  }
  if (!urgent.empty())
  {
    pumpAll(lock, Caller::SUBMITTER);
  }
  EtcMatrix etc(planned.size(), units_.size());
  EtcMatrix energy(inter_core_.gamma > 0.0 ? planned.size() : 0, units_.size());
  std::vector<double> available(units_.size());
  const int64_t now = pi_node::monotonicNs();
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    available[unit->index] = readyIn(*unit, now, nullptr);
    for (size_t i = 0; i < planned.size(); ++i)
    {
      const Cost cost = costOn(*planned[i], *unit);
      etc.at(i, unit->index) = cost.allowed ? cost.plan_s : INF;
      if (energy.tasks() != 0)
      {
        energy.at(i, unit->index) = cost.energy_j;
      }
    }
  }
  const InterCoreOptions options = inter_core_;
  // Planning may take long, so it runs without the lock.
  lock.unlock();
  Assignment assignment;
  {
    std::lock_guard<std::mutex> planning(planning_mutex_);
    batch_scheduler_.schedule(etc, available, options, energy.tasks() != 0 ? &energy : nullptr, &assignment);
  }
  lock.lock();
  for (const uint32_t i : assignment.order)
  {
    TaskState& task = *planned[i];
    if (task.phase != TaskState::Phase::NEW)
    {
      continue;  // cancelled meanwhile
    }
    Unit& unit = *units_[static_cast<size_t>(assignment.unit[i])];
    const Cost cost = costOn(task, unit);
    if (cost.allowed && !stopping_)
    {
      assign(task, unit, cost);
    }
    else
    {
      place(task, ended);
    }
  }
  for (size_t i = 0; i < planned.size(); ++i)
  {
    if (assignment.unit[i] == Assignment::REFUSED && planned[i]->phase == TaskState::Phase::NEW)
    {
      place(*planned[i], ended);  // says why
    }
  }
}

void RuntimeCore::replaceQueued(Unit& unit, const std::function<bool(const TaskState&)>& leaves,
                                std::vector<TaskPtr>* ended)
{
  std::vector<TaskState*> leaving;
  std::copy_if(unit.queue.begin(), unit.queue.end(), std::back_inserter(leaving),
               [&](const TaskState* task) { return leaves(*task); });
  for (TaskState* const task : leaving)
  {
    unit.remove(*task);
    task->phase = TaskState::Phase::NEW;
  }
  for (TaskState* const task : leaving)
  {
    if (Unit* const taker = place(*task, ended))
    {
      taker->wake.notify_one();
    }
  }
}

void RuntimeCore::replaceDelaying(Unit& unit, std::vector<TaskPtr>* ended)
{
  replaceQueued(
      unit, [&](const TaskState& task) { return !costOn(task, unit).allowed; }, ended);
}

bool RuntimeCore::steal(Unit& thief, int64_t now)
{
  thief.look_again_ns = 0;
  TaskState* best = nullptr;
  Cost best_cost;
  double best_gain = 0.0;
  double next_look_s = INF;
  for (const std::unique_ptr<Unit>& victim : units_)
  {
    if (victim.get() == &thief || victim->queue.empty())
    {
      continue;
    }
    next_look_s = std::min(next_look_s, std::max(runningLeft(*victim, now), LOOK_AGAIN_S));
    double finish = readyIn(*victim, now, nullptr);
    int looks = 0;
    for (auto it = victim->queue.rbegin(); it != victim->queue.rend() && looks < MOST_STEAL_LOOKS; ++it, ++looks)
    {
      TaskState& task = **it;
      const double victim_finish = finish;
      finish -= task.expected_s;
      if (!task.request.unit.empty() || task.calibration)
      {
        continue;
      }
      const Cost cost = costOn(task, thief);
      const double gain = victim_finish - cost.plan_s;
      if (cost.allowed && gain > std::max(LEAST_GAIN_S, 0.1 * cost.plan_s) && gain > best_gain)
      {
        best = &task;
        best_cost = cost;
        best_gain = gain;
      }
    }
  }
  if (best == nullptr)
  {
    thief.look_again_ns = next_look_s < INF ? now + pi_node::nanoseconds(next_look_s) : 0;
    return false;
  }
  best->unit->remove(*best);
  best->result.stolen = true;
  ++thief.stolen;
  assign(*best, thief, best_cost);
  return true;
}

}  // namespace pi_runtime
