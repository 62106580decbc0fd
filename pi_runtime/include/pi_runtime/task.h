#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <pi_runtime/codelet.h>
#include <pi_runtime/executor.h>

namespace pi_runtime
{

using StreamId = uint32_t;
constexpr StreamId NO_STREAM = 0;

struct TaskResult
{
  Outcome outcome = Outcome::OK;
  int opencl_code = 0;       ///< of the call that failed, 0 if none did
  std::string message;       ///< what failed and why, with a build log; empty if OK
  std::string unit;          ///< that ran it last; empty if none did
  std::string executor;      ///< "native", "opencl"
  int64_t submitted_ns = 0;  ///< these four on std::chrono::steady_clock
  int64_t started_ns = 0;
  int64_t finished_ns = 0;
  int64_t deadline_ns = 0;   ///< 0: none
  int64_t transfer_ns = 0;   ///< part of the run spent on moving buffers
  double predicted_s = 0.0;  ///< run time as the ETC table had it; 0 if it knew nothing
  uint32_t slices = 1;
  bool stolen = false;  ///< ran on another unit than planned

  bool ok() const { return outcome == Outcome::OK; }
  bool missedDeadline() const { return deadline_ns != 0 && finished_ns > deadline_ns; }
};

/// A computation to be run once.
struct TaskRequest
{
  CodeletPtr codelet;
  std::vector<Argument> arguments;
  uint64_t range = 1;  ///< number of rows, points or work items; > 0
  /// Amount of work, key into the ETC table beside the codelet's name; 0: range.
  double size = 0.0;
  /// After submission. Tasks with deadlines go first, the earliest at the head.
  std::optional<std::chrono::nanoseconds> deadline;
  int priority = 0;  ///< higher goes first among tasks without deadline, and among equal deadlines
  /// The admitted stream of this job. Its deadline is the stream's, unless the task has one.
  StreamId stream = NO_STREAM;
  std::string unit;  ///< must run there; empty: the runtime chooses
  /// Called once when the task has ended, without locks, on the thread that ended it (perhaps the submitting thread).
  /// Must not wait for tasks. May submit tasks; check the outcome first, or failures may submit without end.
  std::function<void(const TaskResult&)> done;
};

struct TaskState;

/// The future of a task. Copies refer to the same task. Destruction does not cancel the task. Thread safe.
class TaskHandle
{
public:
  TaskHandle() = default;

  bool valid() const { return state_ != nullptr; }
  uint64_t id() const;
  bool ready() const;
  /// Returns when the task has ended. @pre valid()
  const TaskResult& wait() const;
  /// @return false if it has not ended within timeout.
  bool waitFor(std::chrono::nanoseconds timeout) const;
  /// Cancels the task if it has not begun. A running native function may poll NativeCall::cancelled(); a sliced task
  /// ends after its slice.
  void cancel() const;

private:
  friend class RuntimeCore;
  explicit TaskHandle(std::shared_ptr<TaskState> state) : state_(std::move(state)) {}
  std::shared_ptr<TaskState> state_;
};

/// Sub-tasks that depend on each other.
struct GraphRequest
{
  struct Edge
  {
    uint32_t from;       ///< index into tasks
    uint32_t to;         ///< starts after `from` ended OK
    double bytes = 0.0;  ///< data handed over [B]; cost time between different memories
  };
  std::vector<TaskRequest> tasks;  ///< deadlines count from the submission of the graph
  std::vector<Edge> edges;
};

}  // namespace pi_runtime
