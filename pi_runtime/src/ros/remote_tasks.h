#pragma once

#include <pi_runtime/GraphEdge.h>
#include <pi_runtime/Task.h>
#include <pi_runtime/TaskReport.h>
#include <pi_runtime/runtime.h>
#include "core/codelet_registry.h"
#include "core/kept_buffers.h"
#include "core/memory_budget.h"
#include "ros/report_thread.h"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
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
  using Listener = RemoteTask::Listener;
  using EntryPtr = std::shared_ptr<RemoteTask>;

  /// What is known of a task.
  struct Answer
  {
    bool known = false;
    TaskReportConstPtr report;  ///< null: not ended yet
  };

  /// @param codelets, buffers  outlive it.
  RemoteTasks(std::shared_ptr<Runtime> runtime, const CodeletRegistry* codelets, KeptBuffers* buffers,
              const Limits& limits);
  /// As close(), and cancels open tasks.
  ~RemoteTasks();
  RemoteTasks(const RemoteTasks&) = delete;
  RemoteTasks& operator=(const RemoteTasks&) = delete;

  /// Runs a task. The listener gets its report, also if it is refused.
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
  /// The reports of ended tasks, null for the others. Handed-over reports are no longer kept.
  std::vector<TaskReportConstPtr> handOver(const std::vector<EntryPtr>& entries);

  Answer query(uint64_t id);
  /// @return false if there is no open task of this id.
  bool cancel(uint64_t id);

  /// Forgets old reports. Each end of a task does this, too.
  void expire();
  size_t openTasks() const;
  size_t keptReports() const;
  size_t memoryBytes() const { return memory_.used(); }

private:
  EntryPtr makeEntry(const TaskConstPtr& task, KeptBuffers::Draft* draft, Listener listener);
  EntryPtr start(const TaskConstPtr& task, Listener listener);
  std::shared_ptr<const void> takeMemory(size_t bytes);
  void requireRoom(size_t tasks) const;
  void enrol(const EntryPtr& entry, TaskHandle handle);
  void finish(EntryPtr entry, TaskReportPtr report);
  void expireLocked();
  void forgetLocked(const EntryPtr& entry);

  const std::shared_ptr<Runtime> runtime_;
  const CodeletRegistry* const codelets_;
  KeptBuffers* const buffers_;
  const Limits limits_;
  MemoryBudget memory_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;  ///< a task has ended, or closing_
  std::map<uint64_t, EntryPtr> entries_;
  std::deque<EntryPtr> kept_;  ///< ended, oldest first
  size_t open_ = 0;
  bool closing_ = false;
  ReportThread reports_;
};

}  // namespace pi_runtime
