#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace pi_runtime
{

enum class TaskOutcome : uint8_t
{
  OK,
  FAILED,
  CANCELLED,
};

/// The record of one task, or of one slice of a sliced task. All times are of the steady clock.
struct TaskTrace
{
  uint64_t task = 0;                ///< number of the task, the same in all its slices
  std::string_view codelet;         ///< name, such as "detect"
  std::string_view implementation;  ///< program that ran, such as "detect.cl"
  uint32_t unit = 0;                ///< computing unit that ran it
  uint32_t slice = 0;               ///< in [0, slices)
  uint32_t slices = 1;
  int64_t submitted_ns = 0;  ///< when the runtime got it
  int64_t queued_ns = 0;     ///< when it waited only for the unit
  int64_t started_ns = 0;    ///< when it began to run, its data in place; 0 if it never ran
  int64_t transfer_ns = 0;   ///< duration of the transfer of its data that ended at started_ns
  int64_t finished_ns = 0;
  int64_t deadline_ns = 0;  ///< 0: none
  TaskOutcome outcome = TaskOutcome::OK;
  bool stolen = false;     ///< ran on another unit than the one planned
  double predicted_s = 0;  ///< expected duration of the run [s]; 0: unknown

  bool ran() const { return started_ns != 0; }
  /// Also true for a task that failed after its deadline.
  bool missedDeadline() const { return deadline_ns != 0 && finished_ns > deadline_ns; }
};

/// Keeps the newest records in bounded memory. All methods may be called from any thread.
///
/// If disabled, a record costs one load. If enabled, it is copied; names are copied when they are new, so that nothing
/// is allocated in the steady state.
class TraceRecorder
{
public:
  static constexpr size_t MAX_NAMES = 4096;  ///< different names kept; all further ones become "(other)"

  /// @param capacity  records kept, about 130 B each; at least 1. Starts enabled.
  /// @throws std::invalid_argument if `capacity` is 0.
  explicit TraceRecorder(size_t capacity);

  void setEnabled(bool enabled) { enabled_.store(enabled, std::memory_order_relaxed); }
  bool enabled() const { return enabled_.load(std::memory_order_relaxed); }

  /// @param record  its names need to live during the call only.
  void record(const TaskTrace& record)
  {
    if (enabled())
    {
      keep(record);
    }
  }

  /// The records kept, oldest first. Their names live as long as the recorder.
  std::vector<TaskTrace> snapshot() const;
  /// Number of records overwritten by newer ones.
  uint64_t dropped() const;
  /// Keeps at least `capacity` records from now on, and enables the recorder.
  void keepAtLeast(size_t capacity);

private:
  void keep(const TaskTrace& record);
  std::string_view intern(std::string_view name);

  std::atomic<bool> enabled_{true};
  mutable std::mutex mutex_;  ///< guards what follows
  size_t capacity_;
  std::vector<TaskTrace> ring_;  ///< once it is full, the oldest one is written over
  size_t next_ = 0;              ///< place of that one
  uint64_t dropped_ = 0;
  std::set<std::string, std::less<>> names_;
};

/// Writes records as Chrome trace events (Trace Event Format, JSON object form) for ui.perfetto.dev, chrome://tracing
/// and draw_gantt. Each unit is a thread. "X" events are the transfer and the run of a task; the run has all fields of
/// the record as arguments. "b" and "e" events are the wait for the unit. A task that never ran is an "i" event.
/// @param units    names by unit number; units without a name are called "unit <number>".
/// @param process  its name. The events have the number of this process, so that traces of several can be put together
///                 (merge_traces).
void writeChromeTrace(std::ostream& stream, const std::vector<TaskTrace>& records,
                      const std::vector<std::string>& units, const std::string& process = "pi_runtime");

}  // namespace pi_runtime
