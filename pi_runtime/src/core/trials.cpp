// RuntimeCore: trials of executors that compile.
#include <pthread.h>
#include <sched.h>

#include <algorithm>

#include "core/runtime_core.h"

namespace pi_runtime
{

void RuntimeCore::queueTrials(const TaskState& task)
{
  if (task.calibration || stopping_)
  {
    return;
  }
  CodeletRecord& record = *task.record;
  const EtcTable::Column used = task.unit->executors[static_cast<size_t>(task.executor)].column;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    for (size_t index = 0; index < unit->executors.size(); ++index)
    {
      const UnitExecutor& entry = unit->executors[index];
      if (!isUntried(entry, record) || !canRun(entry, record) || record.at(entry.column).on_trial || !unit->usable())
      {
        continue;
      }
      const EtcTable::Estimate here = record.row->predict(task.bucket, entry.column);
      const EtcTable::Estimate there = record.row->predict(task.bucket, used);
      if (here.measured && there.measured && here.seconds > there.seconds)
      {
        continue;  // the table of an earlier process knows that it is slower
      }
      record.at(entry.column).on_trial = true;
      Trial trial{task.request.codelet, {}, {}, task.request.range, task.bucket, unit.get(), index};
      for (const Argument& argument : task.request.arguments)
      {
        const bool buffer = argument.isBuffer();
        trial.values.push_back(buffer ? Argument::value(uint8_t{0}) : argument);
        trial.buffers.push_back({argument.access(), buffer ? argument.buffer()->bytes() : 0});
      }
      trials_.push_back(std::move(trial));
      if (!trier_.joinable())
      {
        trier_ = std::thread(&RuntimeCore::trialLoop, this);
      }
      trial_queued_.notify_one();
    }
  }
}

ExecutionReport RuntimeCore::runTrial(const Trial& trial, double* run_s)
{
  const std::atomic<bool> cancelled{false};
  try
  {
    std::vector<Argument> arguments;
    for (size_t i = 0; i < trial.values.size(); ++i)
    {
      const auto [access, bytes] = trial.buffers[i];
      const BufferPtr own = bytes != 0 ? Buffer::allocate(bytes) : nullptr;
      arguments.push_back(bytes == 0                ? trial.values[i]
                          : access == Access::READ  ? Argument::in(own)
                          : access == Access::WRITE ? Argument::out(own)
                                                    : Argument::inOut(own));
    }
    *run_s = trial.unit->executors[trial.executor].executor->tryOut(
        {trial.codelet, arguments, 0, trial.range, trial.range, &cancelled});
    return {};
  }
  catch (...)
  {
    return reportOfCurrentException();
  }
}

void RuntimeCore::trialLoop()
{
  pthread_setname_np(pthread_self(), "pi_trials");
  const sched_param none{};
  pthread_setschedparam(pthread_self(), SCHED_IDLE, &none);  // only what nobody else needs
  Lock lock(mutex_);
  for (;;)
  {
    trial_queued_.wait(lock, [this] { return stopping_ || !trials_.empty(); });
    if (stopping_)
    {
      return;
    }
    const Trial trial = std::move(trials_.front());
    trials_.pop_front();
    trying_ = true;
    lock.unlock();
    double run_s = 0.0;
    const ExecutionReport report = runTrial(trial, &run_s);
    std::vector<TaskPtr> ended;
    lock.lock();
    trying_ = false;
    if (stopping_)
    {
      idle_.notify_all();
      return;
    }
    endTrial(trial, run_s, report, &ended);
    leave(lock, ended);
    lock.lock();
  }
}

void RuntimeCore::endTrial(const Trial& trial, double run_s, const ExecutionReport& report, std::vector<TaskPtr>* ended)
{
  CodeletRecord& record = codelets_[trial.codelet->name];
  if (record.codelet != trial.codelet)
  {
    return;  // another codelet has this name now
  }
  const EtcTable::Column column = trial.unit->executors[trial.executor].column;
  record.at(column).on_trial = false;
  if (report.outcome != Outcome::OK)
  {
    blockExecutor(*trial.unit, record, trial.executor, report, ended);
    return;
  }
  record.at(column).warm = true;
  if (!record.row->predict(trial.bucket, column).measured)
  {
    etc_.record(*record.row, trial.bucket, column, std::max(run_s, 1e-9));
    etc_changed_ = true;
  }
}

}  // namespace pi_runtime
