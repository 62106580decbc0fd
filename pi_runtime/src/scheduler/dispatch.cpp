// RuntimeCore: start and end of tasks on units.
#include <pi_node/durations.h>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/runtime_core.h"

namespace pi_runtime
{
namespace
{

/// First slice of an unknown task: 1/32 of it.
constexpr uint64_t UNKNOWN_SLICES = 32;

bool hasInOut(const TaskRequest& request)
{
  return std::any_of(request.arguments.begin(), request.arguments.end(),
                     [](const Argument& argument)
                     { return argument.isBuffer() && argument.access() == Access::READ_WRITE; });
}

/// The task whose native function this thread runs.
struct TaskHere
{
  RuntimeCore* core = nullptr;
  Unit* unit = nullptr;
  TaskState* task = nullptr;
};
thread_local TaskHere task_here;

Execution executionOf(const TaskState& task)
{
  return Execution{task.request.codelet, task.request.arguments, task.next,
                   task.slice_end,       task.request.range,     &task.cancelled};
}

}  // namespace

uint64_t RuntimeCore::sliceEnd(const Unit& unit, const TaskState& task) const
{
  const uint64_t range = task.request.range;
  const Codelet& codelet = *task.request.codelet;
  if (!codelet.sliceable)
  {
    return range;
  }
  double target_s = std::min(std::chrono::duration<double>(options_.slice).count(), blockingBudget(unit));
  const auto stream = streams_.find(task.request.stream);
  if (stream != streams_.end() && stream->second.unit == &unit)
  {
    target_s = std::min(target_s, stream->second.load.chunk_s);
  }
  double items = 0.0;
  if (task.next != 0)
  {
    items = target_s * static_cast<double>(task.next) / std::max(pi_node::seconds(task.run_ns), 1e-9);
  }
  else if (task.run_s > 0.0)
  {
    if (task.run_s <= target_s)
    {
      return range;
    }
    // Equal slices, rather than a small rest at the end.
    items = static_cast<double>(range) / std::ceil(task.run_s / target_s);
  }
  else
  {
    items = static_cast<double>(range / UNKNOWN_SLICES);
  }
  items = std::min(items, static_cast<double>(task.left()));
  const uint64_t grains = std::max<uint64_t>(static_cast<uint64_t>(items) / codelet.slice_granularity, 1);
  return std::min(range, task.next + grains * codelet.slice_granularity);
}

bool RuntimeCore::mayStart(const Unit& unit, const TaskState& task) const
{
  if (unit.running.empty())
  {
    return true;
  }
  if (unit.arbiter && unit.arbiter->contended())
  {
    return false;  // others get their turn when nothing runs
  }
  // Behind a running task only if both are short and asynchronous: an urgent one that comes now waits for both.
  const Executor& executor = *unit.executors[static_cast<size_t>(task.executor)].executor;
  double sum_s = task.expected_s;
  for (const TaskPtr& running : unit.running)
  {
    if (running->executor != task.executor || !running->measured || running->slice_end != running->request.range)
    {
      return false;
    }
    sum_s += running->expected_s;
  }
  const double longest_s = std::min(std::chrono::duration<double>(options_.pipeline).count(), blockingBudget(unit));
  return executor.asynchronous() && task.measured && task.next == 0 && sum_s <= longest_s &&
         sliceEnd(unit, task) == task.request.range;
}

bool RuntimeCore::takeArbiter(Lock& lock, Unit& unit, const TaskState& task, Caller caller)
{
  const int64_t deadline_ns = task.urgency_ns;
  const int priority = task.request.priority;
  if (unit.waits_for_arbiter)
  {
    // Only the waiting worker may take it; otherwise the worker would wait for its own process.
    unit.arbiter->updateWaiting(deadline_ns, priority);
    return false;
  }
  if (unit.arbiter->tryAcquire())
  {
    unit.holds_arbiter = true;
    return true;
  }
  if (caller != Caller::WORKER)
  {
    unit.wake.notify_one();
    return false;
  }
  unit.waits_for_arbiter = true;
  lock.unlock();
  const bool taken = unit.arbiter->acquire(deadline_ns, priority, std::chrono::seconds(1));
  lock.lock();
  unit.waits_for_arbiter = false;
  unit.holds_arbiter = taken;
  return false;  // the queue may be another by now
}

void RuntimeCore::releaseArbiter(Unit& unit)
{
  if (unit.holds_arbiter && unit.running.empty() && (unit.queue.empty() || unit.arbiter->contended()))
  {
    unit.holds_arbiter = false;
    unit.arbiter->release();
  }
}

void RuntimeCore::pump(Lock& lock, Unit& unit, Caller caller)
{
  while (unit.usable() && !unit.starting && !stopping_)
  {
    if (unit.queue.empty())
    {
      releaseArbiter(unit);
      if (!unit.running.empty() || !options_.stealing || unit.base != nullptr)
      {
        return;
      }
      if (caller != Caller::WORKER)
      {
        const bool work_elsewhere = std::any_of(
            units_.begin(), units_.end(), [](const std::unique_ptr<Unit>& other) { return !other->queue.empty(); });
        if (work_elsewhere)
        {
          unit.wake.notify_one();
        }
        return;
      }
      if (!steal(unit, pi_node::monotonicNs()))
      {
        return;
      }
      continue;
    }
    TaskState& task = **unit.queue.begin();
    if (!mayStart(unit, task))
    {
      return;
    }
    const Executor& executor = *unit.executors[static_cast<size_t>(task.executor)].executor;
    const bool at_once = executor.asynchronous() && executor.ready(executionOf(task));
    // Also from a driver's callback: OpenCL allows calls there that do not block (25 us less per task than by the
    // worker).
    if (caller != Caller::WORKER && !at_once)
    {
      unit.wake.notify_one();
      return;
    }
    if (unit.arbiter && !unit.holds_arbiter && !takeArbiter(lock, unit, task, caller))
    {
      if (caller != Caller::WORKER)
      {
        return;
      }
      continue;
    }
    startTask(lock, unit, task);
  }
  releaseArbiter(unit);  // one that came when the unit was out already
}

void RuntimeCore::startTask(Lock& lock, Unit& unit, TaskState& task)
{
  unit.remove(task);
  task.slice_end = sliceEnd(unit, task);
  task.phase = TaskState::Phase::RUNNING;
  task.executing = true;
  task.started_ns = pi_node::monotonicNs();
  if (task.result.started_ns == 0)
  {
    task.result.started_ns = task.started_ns;
    task.result.predicted_s = task.run_s;
    beginStreamJob(task);
  }
  unit.running.push_back(task.self);
  unit.starting = true;
  if (unit.base != nullptr)
  {
    if (std::exchange(unit.demoted, false))
    {
      setRealTimePriority(pthread_self(), unit.priority);
    }
    unit.cpu_begin_ns = threadCpuNs(pthread_self());
  }
  Executor& executor = *unit.executors[static_cast<size_t>(task.executor)].executor;
  lock.unlock();
  const TaskHere outer = std::exchange(task_here, executor.asynchronous() ? TaskHere() : TaskHere{this, &unit, &task});
  // The task owns itself until onFinished(); two pointers fit into std::function without memory of their own.
  executor.start(executionOf(task),
                 [this, state = &task](const ExecutionReport& report) { onFinished(*state, report); });
  task_here = outer;
  lock.lock();
  unit.starting = false;
  if (stopping_)
  {
    idle_.notify_all();
  }
}

void RuntimeCore::yieldHere()
{
  if (task_here.core != nullptr)
  {
    task_here.core->letUrgentRun(*task_here.unit, *task_here.task);
  }
}

void RuntimeCore::letUrgentRun(Unit& unit, TaskState& outer)
{
  Lock lock(mutex_);
  const auto urgent = [&]
  {
    return !unit.queue.empty() && unit.queue.key_comp()(*unit.queue.begin(), &outer) &&
           !unit.executors[static_cast<size_t>((*unit.queue.begin())->executor)].executor->asynchronous();
  };
  const bool others =
      unit.holds_arbiter && unit.arbiter->contended() && unit.arbiter->nextDeadline() < outer.urgency_ns;
  if (stopping_ || outer.phase != TaskState::Phase::RUNNING || !(urgent() || others))
  {
    return;
  }
  // As if a slice ended here, but for the stack.
  account(unit, outer, ExecutionReport(), pi_node::monotonicNs());
  ++outer.result.slices;
  unit.running.erase(std::remove(unit.running.begin(), unit.running.end(), outer.self), unit.running.end());
  while (urgent() && !stopping_)
  {
    startTask(lock, unit, **unit.queue.begin());
    unit.starting = true;  // the outer one is still being run
  }
  if (others)
  {
    unit.holds_arbiter = false;
    unit.arbiter->release();
    unit.waits_for_arbiter = true;
    while (!unit.holds_arbiter && !stopping_)
    {
      lock.unlock();
      const bool taken = unit.arbiter->acquire(outer.urgency_ns, outer.request.priority, std::chrono::seconds(1));
      lock.lock();
      unit.holds_arbiter = taken;
    }
    unit.waits_for_arbiter = false;
  }
  unit.running.push_front(outer.self);
  outer.started_ns = pi_node::monotonicNs();
  if (unit.base != nullptr)
  {
    unit.cpu_begin_ns = threadCpuNs(pthread_self());
  }
}

void RuntimeCore::account(Unit& unit, TaskState& task, const ExecutionReport& report, int64_t now)
{
  const int64_t begin = std::max(task.started_ns, unit.last_end_ns);
  unit.last_end_ns = now;
  // In a lane other jobs may have run in between; the worker itself comes here.
  const int64_t used = unit.base != nullptr ? threadCpuNs(pthread_self()) - unit.cpu_begin_ns : now - begin;
  unit.busy_ns += used;
  chargeStream(task, used);
  task.run_ns += std::max<int64_t>(used - report.transfer_ns, 0);
  task.result.transfer_ns += report.transfer_ns;
  task.result.unit = unit.name;
  task.result.executor = unit.executors[static_cast<size_t>(task.executor)].executor->name();
  if (trace_.enabled())
  {
    TaskTrace trace;
    trace.task = task.id;
    trace.codelet = task.request.codelet->name;
    trace.implementation = task.result.executor;
    trace.unit = static_cast<uint32_t>(unit.index);
    trace.slice = task.result.slices - 1;
    trace.slices = task.result.slices + (task.slice_end < task.request.range ? 1 : 0);
    trace.submitted_ns = task.submitted_ns;
    trace.queued_ns = task.queued_ns;
    trace.started_ns = std::min(begin + report.transfer_ns, now);
    trace.transfer_ns = report.transfer_ns;
    trace.finished_ns = now;
    trace.deadline_ns = task.realTime() ? task.deadline_ns : 0;
    trace.outcome = report.outcome == Outcome::OK ? TaskOutcome::OK : TaskOutcome::FAILED;
    trace.stolen = task.result.stolen;
    trace.predicted_s = task.run_s;
    trace_.record(trace);
  }
}

void RuntimeCore::learn(const Unit& unit, TaskState& task)
{
  const EtcTable::Column column = unit.executors[static_cast<size_t>(task.executor)].column;
  CodeletRecord::Column& known = task.record->at(column);
  // The first run in a process compiles and fills caches, so its time is not learned.
  if (!known.warm)
  {
    known.warm = true;
    return;
  }
  if (task.moved)
  {
    return;
  }
  const double run_s = std::max(pi_node::seconds(task.run_ns), 1e-9);
  if (task.measured)
  {
    etc_.recordPrediction(task.run_s, run_s);
  }
  etc_.record(*task.record->row, task.bucket, column, run_s);
  etc_changed_ = true;
}

void RuntimeCore::afterGoodRun(Unit& unit, TaskState& task, std::vector<TaskPtr>* ended)
{
  task.next = task.slice_end;
  if (task.cancelled)
  {
    end(task, Outcome::CANCELLED, "cancelled", ended);
    return;
  }
  if (task.next == task.request.range)
  {
    learn(unit, task);
    queueTrials(task);
    end(task, Outcome::OK, "", ended);
    return;
  }
  ++task.result.slices;
  if (!unit.usable())
  {
    task.phase = TaskState::Phase::NEW;
    place(task, ended);
    return;
  }
  task.expected_s =
      std::max(pi_node::seconds(task.run_ns) * static_cast<double>(task.left()) / static_cast<double>(task.next), 1e-9);
  unit.push(task);
}

/// After a failed build: no task tries this program on this unit again.
void RuntimeCore::blockExecutor(Unit& unit, CodeletRecord& record, size_t executor, const ExecutionReport& report,
                                std::vector<TaskPtr>* ended)
{
  const UnitExecutor& entry = unit.executors[executor];
  CodeletRecord::Column& column = record.at(entry.column);
  if (column.blocked)
  {
    return;
  }
  column.blocked = true;
  column.reason.outcome = report.outcome;
  column.reason.opencl_code = report.opencl_code;
  column.reason.message = report.message;
  note("codelet " + record.codelet->name + " does not build on unit " + unit.name + " and is not run by " +
       entry.executor->name() + " there: " + report.message);
  replaceQueued(
      unit,
      [&record, executor](const TaskState& other)
      { return other.record == &record && static_cast<size_t>(other.executor) == executor; },
      ended);
}

void RuntimeCore::afterBadRun(Unit& unit, TaskState& task, const ExecutionReport& report, std::vector<TaskPtr>* ended)
{
  task.result.opencl_code = report.opencl_code;
  ++unit.failures;
  if (report.outcome == Outcome::UNIT_FAILED)
  {
    failUnit(unit, report.message, ended);
    if (hasInOut(task.request))
    {
      end(task, Outcome::UNIT_FAILED,
          unit.name + ": " + report.message + "; not repeated elsewhere, as its in/out buffers may be half written",
          ended);
      return;
    }
  }
  else if (report.outcome == Outcome::BUILD_FAILED)
  {
    blockExecutor(unit, *task.record, static_cast<size_t>(task.executor), report, ended);
  }
  else
  {
    end(task, report.outcome, report.message, ended);
    return;
  }
  if (task.cancelled)
  {
    end(task, Outcome::CANCELLED, "cancelled", ended);
    return;
  }
  // Again on another unit or with another implementation.
  task.phase = TaskState::Phase::NEW;
  task.next = 0;
  task.run_ns = 0;
  place(task, ended);
}

void RuntimeCore::onFinished(TaskState& task, const ExecutionReport& report)
{
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  const TaskPtr keep = task.self;
  Unit& unit = *task.unit;
  const int64_t now = pi_node::monotonicNs();
  task.executing = false;
  unit.running.erase(std::remove(unit.running.begin(), unit.running.end(), keep), unit.running.end());
  bool concerns_all = task.graph != nullptr || report.outcome != Outcome::OK || !unit.usable();
  if (task.phase == TaskState::Phase::ENDED)
  {
    takeBack(unit, task, now, &ended);
    concerns_all = true;
  }
  else
  {
    account(unit, task, report, now);
    if (report.outcome == Outcome::OK)
    {
      afterGoodRun(unit, task, &ended);
    }
    else
    {
      afterBadRun(unit, task, report, &ended);
    }
  }
  releaseArbiter(unit);
  if (concerns_all)
  {
    pumpAll(lock, Caller::COMPLETION);
  }
  else
  {
    pump(lock, unit, Caller::COMPLETION);
  }
  if (stopping_)
  {
    idle_.notify_all();
  }
  leave(lock, ended);
}

/// A task that counted as hanging has ended.
void RuntimeCore::takeBack(Unit& unit, TaskState& task, int64_t now, std::vector<TaskPtr>* ended)
{
  task.self.reset();
  unit.busy_ns += now - std::max(task.started_ns, unit.last_end_ns);
  unit.last_end_ns = now;
  if (!unit.failed || unit.hangs() || stopping_)
  {
    return;
  }
  unit.failed = false;
  note("unit " + unit.name + " answers again and is used again");
  housePlaceless(ended);
}

void RuntimeCore::failUnit(Unit& unit, const std::string& reason, std::vector<TaskPtr>* ended)
{
  if (unit.failed)
  {
    return;
  }
  unit.failed = true;
  unit.failure = reason;
  note("unit " + unit.name + " is taken out, its " + std::to_string(unit.queue.size()) +
       " waiting tasks go elsewhere: " + reason);
  moveStreams(unit, ended);
  replaceQueued(
      unit, [](const TaskState&) { return true; }, ended);
}

void RuntimeCore::pumpAll(Lock& lock, Caller caller)
{
  for (Unit* const unit : all_)
  {
    pump(lock, *unit, caller);
  }
}

void RuntimeCore::wakeIdleWorkers(const Unit& busy)
{
  if (!options_.stealing || (busy.running.empty() && busy.queue.size() < 2))
  {
    return;
  }
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (unit.get() != &busy && unit->usable() && unit->queue.empty() && unit->running.empty() &&
        unit->look_again_ns == 0)
    {
      unit->wake.notify_one();
    }
  }
}

}  // namespace pi_runtime
