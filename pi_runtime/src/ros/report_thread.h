#pragma once

#include <pi_runtime/runtime.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "ros/task_intake.h"

namespace pi_runtime
{

/// A task that came as a message, from submission until its report is forgotten.
struct RemoteTask
{
  /// Called once per task, on the report thread or, if the task was refused, on the caller's thread.
  using Listener = std::function<void(const TaskReportConstPtr&)>;

  uint64_t id = 0;
  TaskIntake intake;
  TaskHandle handle;          ///< valid until the task has ended
  Listener listener;          ///< null: the report is kept
  TaskReportConstPtr report;  ///< null until the task has ended
  std::chrono::steady_clock::time_point ended_at;
};

/// Brings results to the host and makes reports on a thread of its own, so that units go on at once.
class ReportThread
{
public:
  using EntryPtr = std::shared_ptr<RemoteTask>;
  using Finish = std::function<void(EntryPtr entry, TaskReportPtr report)>;

  /// @param finish  gets each report, on this thread.
  explicit ReportThread(Finish finish);
  /// As stop().
  ~ReportThread();
  ReportThread(const ReportThread&) = delete;
  ReportThread& operator=(const ReportThread&) = delete;

  /// The request of a task, made so that its end comes to this thread. Call once per task.
  TaskRequest requestOf(const EntryPtr& entry) const;
  /// Returns when the tasks that have ended are reported. Later ends are ignored.
  void stop();

private:
  /// Tasks that the runtime is done with. Outlives this object with the last task.
  struct Ended
  {
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<std::pair<EntryPtr, TaskResult>> queue;
    bool closed = false;
  };

  void loop();

  const Finish finish_;
  const std::shared_ptr<Ended> ended_;
  std::thread thread_;
};

}  // namespace pi_runtime
