#pragma once

#include <pi_runtime/GraphEdge.h>
#include <pi_runtime/Task.h>
#include <pi_runtime/TaskReport.h>
#include "core/codelet_registry.h"
#include "core/kept_buffers.h"
#include "core/memory_budget.h"
#include "ros/task_intake.h"
#include <pi_runtime/runtime.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace pi_runtime
{

/// Runs tasks that come as messages, and keeps their reports until somebody asks. Needs no master. Thread safe.
///
/// Results are brought to the host and reports handed out on a thread of its own, so that units go on at once.
class RemoteTasks
{
public:
  struct Limits
  {
    size_t max_tasks;         ///< open at once
    size_t max_task_memory;   ///< arguments of open tasks and outputs in kept reports [B]
    size_t max_kept_reports;  ///< the oldest go first
    std::chrono::nanoseconds report_keep;
  };
  /// Called once per task, on a thread of this object or, if the task was refused, the caller's.
  using Listener = std::function<void(const TaskReportConstPtr&)>;

  /// One task from submission on.
  struct Entry
  {
    uint64_t id = 0;
    TaskIntake intake;
    TaskHandle handle;          ///< valid until it has ended
    Listener listener;          ///< null: the report is kept
    TaskReportConstPtr report;  ///< null until it has ended
    std::chrono::steady_clock::time_point ended_at;
  };
  using EntryPtr = std::shared_ptr<Entry>;

  /// What is known of a task.
  struct Answer
  {
    bool known = false;
    TaskReportConstPtr report;  ///< null: not ended yet
  };

  /// @param codelets, buffers  outlive it.
  RemoteTasks(std::shared_ptr<Runtime> runtime, const CodeletRegistry* codelets, KeptBuffers* buffers,
              const Limits& limits);
  /// As close(), and cancels all that is open.
  ~RemoteTasks();
  RemoteTasks(const RemoteTasks&) = delete;
  RemoteTasks& operator=(const RemoteTasks&) = delete;

  /// Runs a task and tells the listener how it ended, be it that it was refused.
  void run(const TaskConstPtr& task, Listener listener);
  /// Runs a task whose report is kept. @throws std::exception with a text that says why it is refused.
  EntryPtr submit(const TaskConstPtr& task);
  /// Runs tasks that depend on each other; kept buffers are made in the order of the tasks. @throws as submit().
  std::vector<EntryPtr> submitGraph(const std::vector<TaskConstPtr>& tasks, const std::vector<GraphEdge>& edges);

  /// @param timeout  0: as long as it takes.
  /// @return false if they have not all ended by then, or when close() was called.
  bool wait(const std::vector<EntryPtr>& entries, std::chrono::nanoseconds timeout);
  /// Makes wait() return.
  void close();
  /// The report of each, as far as it has ended; these are then no longer kept.
  std::vector<TaskReportConstPtr> handOver(const std::vector<EntryPtr>& entries);

  Answer query(uint64_t id);
  /// @return false if there is no open task of this id.
  bool cancel(uint64_t id);

  /// Forgets reports that were kept long enough; also done whenever a task ends.
  void expire();
  size_t openTasks() const;
  size_t keptReports() const;
  size_t memoryBytes() const { return memory_.used(); }

private:
  /// Tasks that the runtime is done with, on their way to the thread. Outlives this object with the last task.
  struct Ended
  {
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<std::pair<EntryPtr, TaskResult>> queue;
    bool closed = false;
  };

  EntryPtr makeEntry(const TaskConstPtr& task, KeptBuffers::Draft* draft, Listener listener);
  TaskRequest requestOf(const EntryPtr& entry) const;
  EntryPtr start(const TaskConstPtr& task, Listener listener);
  std::shared_ptr<const void> takeMemory(size_t bytes);
  void requireRoom(size_t tasks) const;
  void enrol(const EntryPtr& entry, TaskHandle handle);
  void reportLoop();
  TaskReportPtr makeReport(const EntryPtr& entry, TaskResult result);
  void finish(const EntryPtr& entry, const TaskReportPtr& report);
  void expireLocked();
  void forgetLocked(const EntryPtr& entry);

  const std::shared_ptr<Runtime> runtime_;
  const CodeletRegistry* const codelets_;
  KeptBuffers* const buffers_;
  const Limits limits_;
  MemoryBudget memory_;
  const std::shared_ptr<Ended> ended_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;  ///< a task has ended, or closing_
  std::map<uint64_t, EntryPtr> entries_;
  std::deque<EntryPtr> kept_;  ///< ended, oldest first
  size_t open_ = 0;
  bool closing_ = false;
  std::thread thread_;
};

}  // namespace pi_runtime
