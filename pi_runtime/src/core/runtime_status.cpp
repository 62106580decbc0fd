// RuntimeCore: status, settings and the ETC table.
#include <pi_node/durations.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <stdexcept>

#include "core/runtime_core.h"

namespace pi_runtime
{

std::vector<TaskResult> RuntimeCore::calibrate(const TaskRequest& request, int runs)
{
  std::vector<TaskResult> results;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    for (size_t executor = 0; executor < unit->executors.size(); ++executor)
    {
      if (!request.codelet || !unit->executors[executor].executor->supports(*request.codelet) ||
          (!request.unit.empty() && request.unit != unit->name))
      {
        continue;
      }
      TaskPtr task;
      for (int run = 0; run <= std::max(runs, 0); ++run)
      {
        task = makeTask(request);
        task->request.unit = unit->name;
        task->pinned_executor = static_cast<int>(executor);
        task->calibration = true;
        std::vector<TaskPtr> ended;
        Lock lock(mutex_);
        if (enroll(*task, &ended))
        {
          place(*task, &ended);
          pump(lock, *unit, Caller::SUBMITTER);
        }
        leave(lock, ended);
        if (!TaskHandle(task).wait().ok())
        {
          break;
        }
      }
      results.push_back(task->result);
    }
  }
  return results;
}

std::vector<UnitStatus> RuntimeCore::units() const
{
  std::vector<UnitStatus> result;
  std::lock_guard<std::mutex> lock(mutex_);
  const int64_t now = pi_node::monotonicNs();
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    UnitStatus status{};
    status.name = unit->name;
    status.type = unit->type;
    status.bandwidth_bps = std::numeric_limits<double>::infinity();
    for (const UnitExecutor& entry : unit->executors)
    {
      status.executors.emplace_back(entry.executor->name());
      status.bandwidth_bps = std::min(status.bandwidth_bps, entry.bandwidth_bps);
    }
    status.device = unit->device;
    status.memory = toString(unit->memory);
    status.cores = unit->cores;
    status.preemptive = !unit->lanes.empty();
    status.scheduling = unit->scheduling;
    status.compute_units = unit->compute_units;
    status.fp16 = unit->fp16;
    status.fp64 = unit->fp64;
    status.active_power_w = unit->tuning.active_power_w;
    status.idle_power_w = unit->tuning.idle_power_w;
    status.failed = !unit->usable();
    status.failure = unit->whyOut();
    status.queued = unit->queue.size();
    status.running = unit->running.size();
    status.load_s = readyIn(*unit, now, nullptr);
    status.blocking_budget_s = blockingBudget(*unit);
    status.tasks = unit->tasks;
    status.failures = unit->failures;
    status.stolen = unit->stolen;
    status.deadline_tasks = unit->deadline_tasks;
    status.missed_deadlines = unit->missed_deadlines;
    // What runs now counts up to now.
    const int64_t running_ns =
        unit->running.empty() ? 0 : now - std::max(unit->running.front()->started_ns, unit->last_end_ns);
    int64_t busy_ns = unit->busy_ns + running_ns;
    for (const Unit* const lane : unit->lanes)
    {
      status.queued += lane->queue.size();
      status.running += lane->running.size();
      status.load_s += readyIn(*lane, now, nullptr);
      status.tasks += lane->tasks;
      status.failures += lane->failures;
      status.deadline_tasks += lane->deadline_tasks;
      status.missed_deadlines += lane->missed_deadlines;
      busy_ns += lane->busy_ns;
    }
    status.busy_s = pi_node::seconds(busy_ns);
    const int64_t since = now - unit->reported_at_ns;
    status.utilisation =
        since > 0
            ? std::clamp(static_cast<double>(busy_ns - unit->reported_busy_ns) / static_cast<double>(since), 0.0, 1.0)
            : 0.0;
    unit->reported_busy_ns = busy_ns;
    unit->reported_at_ns = now;
    result.push_back(std::move(status));
  }
  return result;
}

RuntimeStatistics RuntimeCore::statistics() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  RuntimeStatistics result = statistics_;
  result.prediction_error = etc_.predictionError();
  return result;
}

InterCoreOptions RuntimeCore::interCoreOptions() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return inter_core_;
}

void RuntimeCore::setInterCoreOptions(const InterCoreOptions& options)
{
  options.validate();
  std::lock_guard<std::mutex> lock(mutex_);
  inter_core_ = options;
}

InnerCoreOptions RuntimeCore::innerCoreOptions() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return inner_core_;
}

void RuntimeCore::setInnerCoreOptions(const InnerCoreOptions& options)
{
  std::lock_guard<std::mutex> lock(mutex_);
  inner_core_ = options;
}

std::vector<EtcTable::Entry> RuntimeCore::etcEntries() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return etc_.entries();
}

void RuntimeCore::setEtcEntries(const std::vector<EtcTable::Entry>& entries)
{
  std::lock_guard<std::mutex> lock(mutex_);
  for (const EtcTable::Entry& entry : entries)
  {
    etc_.set(entry);
    etc_changed_ = true;
  }
}

void RuntimeCore::clearEtc()
{
  std::lock_guard<std::mutex> lock(mutex_);
  etc_.clear();
  etc_changed_ = true;
}

double RuntimeCore::predict(const CodeletPtr& codelet, double size, const std::string& name) const
{
  if (!codelet)
  {
    throw std::invalid_argument("predict: the codelet is null");
  }
  std::lock_guard<std::mutex> lock(mutex_);
  const Unit* const unit = findUnit(name);
  if (unit == nullptr)
  {
    throw std::invalid_argument("there is no unit \"" + name + "\", there are " + unitNames());
  }
  const EtcTable::Row* const row = etc_.find(codelet->name);
  const auto record = codelets_.find(codelet->name);
  double best = std::numeric_limits<double>::infinity();
  bool supported = false;
  for (const UnitExecutor& entry : unit->executors)
  {
    const bool blocked = record != codelets_.end() && entry.column < record->second.columns.size() &&
                         record->second.columns[entry.column].blocked;
    if (blocked || !entry.executor->supports(*codelet))
    {
      continue;
    }
    supported = true;
    if (row == nullptr)
    {
      continue;
    }
    const EtcTable::Estimate estimate = row->predict(EtcTable::sizeBucket(size), entry.column);
    if (estimate.known)
    {
      best = std::min(best, estimate.seconds);
    }
  }
  return supported && std::isinf(best) ? 0.0 : best;
}

void RuntimeCore::loadEtc()
{
  std::error_code ignored;
  if (options_.etc_file.empty() || !std::filesystem::exists(options_.etc_file, ignored))
  {
    return;
  }
  try
  {
    etc_.load(options_.etc_file);
  }
  catch (const std::runtime_error& error)
  {
    say(LogLevel::WARNING, std::string(error.what()) + "; the runtime learns anew");
  }
}

void RuntimeCore::saveEtc(Lock& lock)
{
  if (options_.etc_file.empty() || !etc_changed_)
  {
    return;
  }
  etc_changed_ = false;
  const EtcTable copy = etc_;
  lock.unlock();
  try
  {
    copy.save(options_.etc_file);
  }
  catch (const std::runtime_error& error)
  {
    say(LogLevel::WARNING, error.what());
  }
  lock.lock();
}

}  // namespace pi_runtime
