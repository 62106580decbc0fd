#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <pi_runtime/runtime_options.h>
#include "core/task_state.h"
#include "scheduler/edf_admission.h"
#include "units/unit_arbiter.h"

namespace pi_runtime
{

/// One way to execute on a unit.
struct UnitExecutor
{
  std::unique_ptr<Executor> executor;
  EtcTable::Column column = 0;
  double bandwidth_bps = std::numeric_limits<double>::infinity();
};

/// True if the executor has an implementation of the codelet to run, as far as is known.
inline bool canRun(const UnitExecutor& entry, CodeletRecord& record)
{
  return entry.executor->supports(*record.codelet) && !record.at(entry.column).blocked;
}

/// True if the executor would have to compile the codelet first.
inline bool isUntried(const UnitExecutor& entry, CodeletRecord& record)
{
  return entry.executor->compiles() && !record.at(entry.column).warm;
}

/// A computing unit: executors, queue and thread. The lock of RuntimeCore guards all but the constant fields.
struct Unit
{
  explicit Unit(bool fifo) : queue(TaskOrder{fifo}) {}

  // Constant.
  std::string name;
  size_t index = 0;
  UnitType type = UnitType::CPU;
  std::vector<int> cores;
  std::vector<UnitExecutor> executors;
  std::string device;
  MemoryModel memory = MemoryModel::DIRECT;
  unsigned compute_units = 1;
  bool fp16 = false;
  bool fp64 = true;
  UnitTuning tuning;
  std::unique_ptr<UnitArbiter> arbiter;  ///< null: not shared with other processes
  /// A lane: runs the native jobs of one real-time priority on the cores of its base, and interrupts the base and lower
  /// lanes by the operating system. It has a worker as soon as it has a stream.
  Unit* base = nullptr;
  int priority = 0;          ///< of a lane: SCHED_FIFO
  std::vector<Unit*> lanes;  ///< of a base, by priority from LOWEST_PRIORITY on; empty: it is not pre-emptive
  std::string scheduling;    ///< of a base: class of its threads, for people

  bool failed = false;
  bool withdrawn = false;  ///< by setUnitAvailable()
  std::string failure;

  std::set<TaskState*, TaskOrder> queue;           ///< tasks own themselves until they end
  double queued_s = 0.0;                           ///< sum of expected_s in the queue
  std::deque<std::shared_ptr<TaskState>> running;  ///< in the order of their start
  bool starting = false;                           ///< a thread has taken a task and is starting it
  bool holds_arbiter = false;
  bool waits_for_arbiter = false;
  int64_t last_end_ns = 0;

  std::thread worker;
  std::condition_variable wake;
  bool worker_left = false;
  int64_t cpu_begin_ns = 0;   ///< of a lane: processor time of its worker when the job or slice began
  bool demoted = false;       ///< of a lane: its job ran away and has lost the priority
  int64_t look_again_ns = 0;  ///< when the idle worker looks for work to steal again; 0: when woken

  std::vector<std::pair<StreamId, PeriodicLoad>> streams;
  std::vector<PeriodicLoad> analysed;                                  ///< those that blocking_budget_s is for
  double blocking_budget_s = std::numeric_limits<double>::infinity();  ///< by the streams of this process
  double others_budget_s = std::numeric_limits<double>::infinity();    ///< by those of other processes

  uint64_t tasks = 0;
  uint64_t failures = 0;
  uint64_t stolen = 0;
  uint64_t deadline_tasks = 0;
  uint64_t missed_deadlines = 0;
  int64_t busy_ns = 0;
  mutable int64_t reported_busy_ns = 0;  ///< at the last report
  mutable int64_t reported_at_ns = 0;

  bool usable() const { return !failed && !withdrawn && (base == nullptr || base->usable()); }
  std::string whyOut() const { return failed ? failure : withdrawn ? "taken out by request" : ""; }
  Unit& own() { return base != nullptr ? *base : *this; }
  const Unit& own() const { return base != nullptr ? *base : *this; }
  /// A task that counts as hanging still runs on it.
  bool hangs() const
  {
    return std::any_of(running.begin(), running.end(),
                       [](const std::shared_ptr<TaskState>& task) { return task->phase == TaskState::Phase::ENDED; });
  }

  void push(TaskState& task)
  {
    task.phase = TaskState::Phase::QUEUED;
    task.unit = this;
    queue.insert(&task);
    queued_s += task.expected_s;
  }
  void remove(TaskState& task)
  {
    queue.erase(&task);
    // Rounding errors must not add up over millions of tasks.
    queued_s = queue.empty() ? 0.0 : queued_s - task.expected_s;
  }
};

/// A lane of the unit, which has native functions.
std::unique_ptr<Unit> makeLane(Unit* base, int priority);

/// The units of the options, without threads. @param problems  one line per device that cannot be used.
std::vector<std::unique_ptr<Unit>> makeUnits(const RuntimeOptions& options, std::vector<CustomUnit> custom,
                                             std::vector<std::string>* problems);

}  // namespace pi_runtime
