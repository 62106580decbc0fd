// RuntimeCore: life of tasks, what users ask for.
#include "core/runtime_core.h"

#include <linux/futex.h>
#include <pi_node/durations.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <utility>

namespace pi_runtime
{

std::string milliseconds(double seconds)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.3g ms", seconds * 1e3);
  return text;
}

RuntimeCore::RuntimeCore(const RuntimeOptions& options, std::vector<CustomUnit> units)
  : options_(options)
  , trace_(std::max<size_t>(options.trace_capacity, 1))
  , inter_core_(options.inter_core)
  , inner_core_(options.inner_core)
{
  options_.validate();
  trace_.setEnabled(options_.trace_capacity != 0);
  std::vector<std::string> problems;
  units_ = makeUnits(options_, std::move(units), &problems);
  for (const std::string& problem : problems)
  {
    say(LogLevel::WARNING, problem);
  }
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    unit->reported_at_ns = pi_node::monotonicNs();
    for (UnitExecutor& entry : unit->executors)
    {
      entry.column = etc_.column(unit->name + "/" + entry.executor->name());
      separate_memory_ = separate_memory_ || entry.executor->memory() != nullptr;
    }
  }
  loadEtc();
  makeLanes();
}

void RuntimeCore::start()
{
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    startWorker(*unit);
  }
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  refreshOthersBudgets(&ended);
  lock.unlock();
  watcher_ = std::thread(&RuntimeCore::watchLoop, this);
}

void RuntimeCore::stop()
{
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  stopping_ = true;
  for (Unit* const unit : all_)
  {
    while (!unit->queue.empty())
    {
      TaskState& task = **unit->queue.begin();
      unit->remove(task);
      end(task, Outcome::SHUT_DOWN, "the runtime ended before it began", &ended);
    }
    for (const TaskPtr& task : unit->running)
    {
      task->cancelled = true;
    }
    unit->wake.notify_all();
    if (unit->arbiter && unit->waits_for_arbiter)
    {
      unit->arbiter->cancelWait();
    }
  }
  watch_.notify_all();
  trial_queued_.notify_all();
  leave(lock, ended);
  watcher_.join();
  lock.lock();
  const auto at_rest = [this]
  {
    return announcing_ == 0 && !trying_ &&
           std::all_of(all_.begin(), all_.end(),
                       [](const Unit* unit) { return unit->worker_left && unit->running.empty() && !unit->starting; });
  };
  const bool clean = idle_.wait_for(lock, options_.hang_timeout, at_rest);
  saveEtc(lock);
  ended.clear();
  for (Unit* const unit : all_)
  {
    for (const TaskPtr& task : std::deque<TaskPtr>(unit->running))
    {
      if (task->phase == TaskState::Phase::RUNNING)
      {
        end(*task, Outcome::UNIT_FAILED, unit->name + " hangs, and the runtime ends", &ended);
      }
    }
  }
  leave(lock, ended);
  for (Unit* const unit : all_)
  {
    if (unit->worker.joinable())
    {
      clean ? unit->worker.join() : unit->worker.detach();
    }
  }
  if (trier_.joinable())
  {
    clean ? trier_.join() : trier_.detach();
  }
  if (!clean)
  {
    // A driver or a function of the user still runs and will call this object.
    say(LogLevel::WARNING, "the runtime ends while a unit hangs; its memory is not given back");
    new std::shared_ptr<RuntimeCore>(shared_from_this());
  }
}

void RuntimeCore::say(LogLevel level, const std::string& text) const
{
  if (options_.log)
  {
    options_.log(level, text);
  }
}

void RuntimeCore::note(const std::string& warning)
{
  if (options_.log)
  {
    warnings_.push_back(warning);
  }
}

void RuntimeCore::leave(Lock& lock, const std::vector<TaskPtr>& ended)
{
  const std::vector<std::string> warnings = std::exchange(warnings_, {});
  const bool calls =
      !warnings.empty() ||
      std::any_of(ended.begin(), ended.end(), [](const TaskPtr& task) { return task->request.done != nullptr; });
  announcing_ += calls ? 1 : 0;
  lock.unlock();
  for (const std::string& warning : warnings)
  {
    say(LogLevel::WARNING, warning);
  }
  announce(ended);
  if (calls)
  {
    // The destructor waits for this: callbacks may use the runtime. Without callbacks nothing of it is touched above.
    lock.lock();
    --announcing_;
    if (stopping_)
    {
      idle_.notify_all();
    }
    lock.unlock();
  }
}

std::string RuntimeCore::problemOf(const TaskRequest& request) const
{
  if (!request.codelet)
  {
    return "there is no codelet";
  }
  if (request.range == 0)
  {
    return "range = 0 of codelet " + request.codelet->name + ", must be at least 1";
  }
  if (!std::isfinite(request.size) || request.size < 0.0)
  {
    return "size = " + std::to_string(request.size) + " of codelet " + request.codelet->name +
           ", must be finite and at least 0 (0: the range)";
  }
  if (request.stream != NO_STREAM && streams_.count(request.stream) == 0)
  {
    return "stream = " + std::to_string(request.stream) + " of codelet " + request.codelet->name +
           " is not admitted; admit it first, or leave it 0";
  }
  if (!request.unit.empty() && findUnit(request.unit) == nullptr)
  {
    return "there is no unit \"" + request.unit + "\", there are " + unitNames();
  }
  return "";
}

std::string RuntimeCore::refusalOf(const TaskRequest& request)
{
  Lock lock(mutex_);
  std::string problem = problemOf(request);
  if (!problem.empty())
  {
    return problem;
  }
  const TaskPtr task = makeTask(request);
  task->self.reset();  // it is not submitted
  task->record = &recordOf(request.codelet);
  std::vector<Cost> costs;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    costs.push_back(costOn(*task, *unit));
    if (costs.back().allowed)
    {
      return "";
    }
  }
  const TaskResult refusal = refusalOf(*task, costs);
  return refusal.outcome == Outcome::REFUSED ? refusal.message : "";
}

CodeletRecord& RuntimeCore::recordOf(const CodeletPtr& codelet)
{
  CodeletRecord& record = codelets_[codelet->name];
  if (record.codelet != codelet)
  {
    // New, or another codelet under a known name: forget build failures of the old one.
    record.codelet = codelet;
    record.columns.clear();
    record.row = &etc_.row(codelet->name);
  }
  return record;
}

TaskPtr RuntimeCore::makeTask(TaskRequest request)
{
  auto task = std::make_shared<TaskState>();
  task->self = task;
  task->core = weak_from_this();
  task->submitted_ns = pi_node::monotonicNs();
  task->request = std::move(request);
  task->bucket =
      EtcTable::sizeBucket(task->request.size > 0.0 ? task->request.size : static_cast<double>(task->request.range));
  if (task->request.deadline)
  {
    task->deadline_ns = timeAfter(task->submitted_ns, *task->request.deadline);
  }
  return task;
}

TaskHandle RuntimeCore::submit(TaskRequest request)
{
  TaskPtr task = makeTask(std::move(request));
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  if (enroll(*task, &ended))
  {
    if (Unit* const unit = place(*task, &ended))
    {
      wakeIdleWorkers(*unit);
      pump(lock, *unit, Caller::SUBMITTER);
    }
  }
  leave(lock, ended);
  return TaskHandle(std::move(task));
}

bool RuntimeCore::enroll(TaskState& task, std::vector<TaskPtr>* ended)
{
  task.id = next_task_++;
  ++statistics_.submitted;
  if (stopping_)
  {
    end(task, Outcome::SHUT_DOWN, "the runtime has ended", ended);
    return false;
  }
  const std::string problem = problemOf(task.request);
  if (!problem.empty())
  {
    end(task, Outcome::REFUSED, problem, ended);
    return false;
  }
  if (options_.queue_order == QueueOrder::FIFO)
  {
    task.sequence = next_sequence_++;
  }
  task.record = &recordOf(task.request.codelet);
  const auto stream = streams_.find(task.request.stream);
  if (stream != streams_.end() && !task.realTime() && stream->second.load.deadline_s > 0.0)
  {
    task.deadline_ns = task.submitted_ns + pi_node::nanoseconds(stream->second.load.deadline_s);
  }
  task.urgency_ns = task.deadline_ns;
  if (stream != streams_.end())
  {
    const Stream& of = stream->second;
    // Without capacity, it is behind those that have some, and before other work.
    const bool behind = of.unit == nullptr && of.request.best_effort;
    task.urgency_ns = behind ? NO_DEADLINE_NS : std::max(task.urgency_ns, of.server_deadline_ns);
    task.request.priority = behind ? std::numeric_limits<int>::max() : task.request.priority;
  }
  return true;
}

std::vector<TaskHandle> RuntimeCore::submitBatch(std::vector<TaskRequest> requests)
{
  std::vector<TaskHandle> handles;
  std::vector<TaskPtr> batch;
  std::vector<TaskPtr> ended;
  handles.reserve(requests.size());
  for (TaskRequest& request : requests)
  {
    handles.push_back(TaskHandle(makeTask(std::move(request))));
  }
  Lock lock(mutex_);
  for (const TaskHandle& handle : handles)
  {
    if (enroll(*handle.state_, &ended))
    {
      batch.push_back(handle.state_);
    }
  }
  placeBatch(lock, batch, &ended);
  pumpAll(lock, Caller::SUBMITTER);
  leave(lock, ended);
  return handles;
}

void RuntimeCore::cancel(TaskState& task)
{
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  task.cancelled = true;
  if (task.phase == TaskState::Phase::NEW || task.phase == TaskState::Phase::QUEUED)
  {
    if (task.phase == TaskState::Phase::QUEUED)
    {
      task.unit->remove(task);
    }
    end(task, Outcome::CANCELLED, task.next == 0 ? "cancelled before it began" : "cancelled between slices", &ended);
    pumpAll(lock, Caller::COMPLETION);
  }
  leave(lock, ended);
}

void RuntimeCore::end(TaskState& task, Outcome outcome, const std::string& message, std::vector<TaskPtr>* ended)
{
  const TaskPtr keep = task.shared_from_this();
  task.phase = TaskState::Phase::ENDED;
  TaskResult& result = task.result;
  result.outcome = outcome;
  result.message = message;
  result.submitted_ns = task.submitted_ns;
  result.finished_ns = pi_node::monotonicNs();
  result.deadline_ns = task.realTime() ? task.deadline_ns : 0;
  switch (outcome)
  {
    case Outcome::OK:
      ++statistics_.ended_ok;
      break;
    case Outcome::CANCELLED:
    case Outcome::SHUT_DOWN:
      ++statistics_.cancelled;
      break;
    case Outcome::REFUSED:
      ++statistics_.refused;
      break;
    default:
      ++statistics_.failed;
  }
  const bool missed = result.missedDeadline();
  statistics_.missed_deadlines += missed ? 1 : 0;
  if (task.unit != nullptr && result.started_ns != 0)
  {
    ++task.unit->tasks;
    task.unit->deadline_tasks += task.realTime() ? 1 : 0;
    task.unit->missed_deadlines += missed ? 1 : 0;
  }
  countStreamJob(task);
  if (!task.executing)
  {
    task.self.reset();
  }
  ended->push_back(keep);
  if (task.graph)
  {
    endGraphNode(task, ended);
  }
}

void RuntimeCore::announce(const std::vector<TaskPtr>& ended) const
{
  for (const TaskPtr& task : ended)
  {
    task->ended.store(1);
    if (task->waiters.load() != 0)
    {
      syscall(SYS_futex, &task->ended, FUTEX_WAKE_PRIVATE, INT_MAX, nullptr, nullptr, 0);
    }
    if (!task->request.done)
    {
      continue;
    }
    try
    {
      task->request.done(task->result);
    }
    catch (const std::exception& error)
    {
      say(LogLevel::WARNING, "TaskRequest.done of task " + std::to_string(task->id) + " threw: " + error.what());
    }
    catch (...)
    {
      say(LogLevel::WARNING, "TaskRequest.done of task " + std::to_string(task->id) + " threw no std::exception");
    }
  }
}

Unit* RuntimeCore::findUnit(const std::string& name) const
{
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (unit->name == name)
    {
      return unit.get();
    }
  }
  return nullptr;
}

std::string RuntimeCore::unitNames() const
{
  std::string names;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    names += (names.empty() ? "" : ", ") + unit->name;
  }
  return names;
}

void RuntimeCore::setUnitAvailable(const std::string& name, bool available)
{
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  Unit* const unit = findUnit(name);
  if (unit == nullptr)
  {
    throw std::invalid_argument("there is no unit \"" + name + "\", there are " + unitNames());
  }
  unit->withdrawn = !available;
  if (available)
  {
    unit->failed = unit->hangs();  // if so, it comes back when it answers
    housePlaceless(&ended);
  }
  else
  {
    std::vector<Unit*> leaving = unit->lanes;
    leaving.push_back(unit);
    for (Unit* const each : leaving)
    {
      moveStreams(*each, &ended);
      replaceQueued(
          *each, [](const TaskState&) { return true; }, &ended);
    }
  }
  pumpAll(lock, Caller::COMPLETION);
  leave(lock, ended);
}

}  // namespace pi_runtime
