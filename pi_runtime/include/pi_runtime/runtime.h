#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <pi_runtime/etc_table.h>
#include <pi_runtime/executor.h>
#include <pi_runtime/inner_core_scheduler.h>
#include <pi_runtime/inter_core_scheduler.h>
#include <pi_runtime/runtime_options.h>
#include <pi_runtime/task.h>
#include <pi_runtime/trace.h>

namespace pi_runtime
{

class RuntimeCore;

/// A unit as it is now.
struct UnitStatus
{
  std::string name;
  UnitType type;
  std::vector<std::string> executors;  ///< "native", "opencl"
  std::string device;                  ///< name of the OpenCL device; empty if there is none
  std::string memory;                  ///< "direct", "mapped", "separate"
  std::vector<int> cores;              ///< CPU cores that it occupies
  bool preemptive;                     ///< short jobs of streams interrupt longer ones; false: nothing is interrupted
  std::string scheduling;              ///< scheduling classes of its threads, and what is missing for better ones
  unsigned compute_units;
  bool fp16;
  bool fp64;
  double bandwidth_bps;  ///< to and from its memory [B/s]; infinite where memory is shared
  double active_power_w;
  double idle_power_w;
  bool failed;
  std::string failure;       ///< why, if failed
  size_t queued;             ///< tasks waiting
  size_t running;            ///< tasks handed to the unit
  double load_s;             ///< expected time for queued and running tasks, by the ETC table
  double blocking_budget_s;  ///< longest batch task (or slice) that it may take; infinite without streams
  uint64_t tasks;            ///< ended here
  uint64_t failures;
  uint64_t stolen;  ///< taken over from other units
  uint64_t deadline_tasks;
  uint64_t missed_deadlines;
  double busy_s;       ///< since the start
  double utilisation;  ///< busy part of the time since the last call of units(), 0..1
};

/// A periodic task whose deadline must hold.
struct StreamRequest
{
  std::string name;  ///< for messages
  CodeletPtr codelet;
  double size = 1.0;  ///< of each job, as TaskRequest::size
  std::chrono::nanoseconds period{0};
  std::chrono::nanoseconds deadline{0};  ///< after submission; 0: the period
  /// Longest run time; 0: mean + 3 deviations of the ETC table.
  std::chrono::nanoseconds wcet{0};
  /// Longest part of a run between two calls of Stage::yield(); 0: the whole run, or a slice.
  std::chrono::nanoseconds piece{0};
  /// Never refused: without capacity, its jobs run behind all streams that have some. Its period may be 0: not known.
  bool best_effort = false;
};

struct StreamStatus
{
  StreamId id;  ///< NO_STREAM: of another process
  int pid;
  std::string name;
  std::string unit;  ///< where its capacity is reserved; empty: nowhere
  int priority;      ///< real-time priority of its jobs; 0: none, they interrupt nothing
  double period_s;
  double deadline_s;
  double wcet_s;
  uint64_t jobs;
  uint64_t missed;
  double p50_s;  ///< response time over the last 1024 jobs
  double p99_s;
  double max_s;  ///< ever
};

struct Admission
{
  StreamId id = NO_STREAM;                      ///< NO_STREAM: refused
  std::string unit;                             ///< where capacity is reserved; empty: nowhere
  std::string reason;                           ///< why none is reserved: one clause per unit
  std::chrono::nanoseconds shortest_period{0};  ///< with which it would fit; 0: it fits, or with none
  bool admitted() const { return id != NO_STREAM; }
};

struct RuntimeStatistics
{
  uint64_t submitted;
  uint64_t ended_ok;
  uint64_t cancelled;
  uint64_t refused;
  uint64_t failed;
  uint64_t missed_deadlines;
  EtcTable::PredictionError prediction_error;
};

/// Runs tasks on the computing units of this device: the paper's runtime layer (π-Edge, section IV).
///
/// Each unit runs one task (or one slice) at a time, which short jobs of streams may interrupt (preemption). Tasks with
/// deadlines go first (EDF). A unit with admitted streams takes no work that could break their deadlines. The
/// inter-core policy places independent tasks by the ETC table, the inner-core policy places graphs. An idle unit
/// steals tasks that it would finish earlier. If a unit fails, its tasks move to other units.
///
/// Thread safe. The destructor cancels tasks that have not begun, and waits for running tasks and their callbacks. A
/// task that exceeds the hang timeout keeps its memory.
class Runtime
{
public:
  /// Finds the units. @throws std::invalid_argument for impossible options, std::runtime_error if no unit is left.
  explicit Runtime(const RuntimeOptions& options = RuntimeOptions());
  /// As above, with further units of the caller.
  Runtime(const RuntimeOptions& options, std::vector<CustomUnit> units);
  ~Runtime();
  Runtime(const Runtime&) = delete;
  Runtime& operator=(const Runtime&) = delete;

  /// The runtime that the nodelets of one process share. The first call makes it with its options; it ends with the
  /// last pointer.
  static std::shared_ptr<Runtime> shared(const RuntimeOptions& options = RuntimeOptions());

  /// Does not wait for the task. An invalid request ends with Outcome::REFUSED.
  TaskHandle submit(TaskRequest request);
  /// Why submit() would end the request with Outcome::REFUSED now, one text per cause; empty if it would not.
  std::string refusalOf(const TaskRequest& request) const;
  /// A metatask: independent tasks, placed together. They may start in any order.
  std::vector<TaskHandle> submitBatch(std::vector<TaskRequest> requests);
  /// If a sub-task does not end OK, its successors are cancelled. @return handles of the sub-tasks, in their order.
  /// @throws std::invalid_argument if the edges form a cycle; nothing is submitted then.
  std::vector<TaskHandle> submitGraph(GraphRequest request);

  /// Reserves capacity for a stream of jobs with deadlines on the unit where it fits best.
  Admission admit(const StreamRequest& request);
  /// The stream with other figures; it keeps id and statistics. If these do not fit, it keeps its capacity as well.
  Admission amend(StreamId id, const StreamRequest& request);
  /// Gives the capacity back. Unknown ids are ignored.
  void retire(StreamId id);
  /// Those of this process, then those of others on the same units.
  std::vector<StreamStatus> streams() const;

  /// Runs the task on every unit and executor that can: once to compile and fill caches, then `runs` times for the ETC
  /// table. Blocks. Each run writes the buffers of the arguments.
  /// @return one result per unit and executor.
  std::vector<TaskResult> calibrate(const TaskRequest& request, int runs = 5);

  /// Puts the calling thread above all jobs of streams, which would else keep it waiting. For threads that hand over what
  /// sensors send, use little, and leave heavy work to streams. Does nothing where no unit is preemptive.
  void raiseThread() const;

  std::vector<UnitStatus> units() const;
  /// Takes a unit out of use, or a failed unit back into use. Its tasks move to other units. A unit that hangs comes
  /// back when it answers.
  /// @throws std::invalid_argument if unknown.
  void setUnitAvailable(const std::string& unit, bool available);
  RuntimeStatistics statistics() const;

  InterCoreOptions interCoreOptions() const;
  /// For what is submitted from now on. @throws std::invalid_argument
  void setInterCoreOptions(const InterCoreOptions& options);
  InnerCoreOptions innerCoreOptions() const;
  void setInnerCoreOptions(const InnerCoreOptions& options);

  std::vector<EtcTable::Entry> etcEntries() const;
  /// @throws std::invalid_argument naming the impossible entry; earlier ones are set.
  void setEtcEntries(const std::vector<EtcTable::Entry>& entries);
  void clearEtc();
  /// Expected run time of a codelet on a unit, by its best executor [s]; 0 if nothing is known, infinite if it cannot
  /// run there. @throws std::invalid_argument if there is no such unit or no codelet.
  double predict(const CodeletPtr& codelet, double size, const std::string& unit) const;

  TraceRecorder& trace();
  /// Writes the trace as Chrome trace events, see writeChromeTrace(). With the environment variable PI_RUNTIME_TRACE
  /// set to a folder each runtime records, and writes PROGRAM_PID.json into it at its end; merge_traces puts them
  /// together.
  /// @throws std::runtime_error if the file cannot be written.
  void writeTrace(const std::string& path);

private:
  std::shared_ptr<RuntimeCore> core_;
};

}  // namespace pi_runtime
