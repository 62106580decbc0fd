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
  double load_s;             ///< until it is done with both, by the ETC table
  double blocking_budget_s;  ///< longest uninterrupted stretch of batch work; infinite without streams
  uint64_t tasks;            ///< ended here
  uint64_t failures;
  uint64_t stolen;  ///< taken over from other units
  uint64_t deadline_tasks;
  uint64_t missed_deadlines;
  double busy_s;       ///< since the start
  double utilisation;  ///< part of the time since the last call of units() that it was busy, 0..1
};

/// A task that comes again and again, with a deadline that must hold.
struct StreamRequest
{
  std::string name;  ///< for messages
  CodeletPtr codelet;
  double size = 1.0;  ///< of each job, as TaskRequest::size
  std::chrono::nanoseconds period{0};
  std::chrono::nanoseconds deadline{0};  ///< after submission; 0: the period
  /// Longest run time; 0: mean + 3 deviations of the ETC table.
  std::chrono::nanoseconds wcet{0};
};

struct StreamStatus
{
  StreamId id;
  std::string name;
  std::string unit;  ///< where its capacity is reserved
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
  StreamId id = NO_STREAM;  ///< NO_STREAM: refused
  std::string reason;       ///< why it was refused: one clause per unit
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
/// Each unit runs one task (or one slice) at a time. Tasks with deadlines go first (EDF); a unit on which streams are
/// admitted takes no work that would hold it longer than their deadlines stand. Independent tasks are placed by the
/// inter-core policy on the ETC table, graphs by the inner-core policy; an idle unit steals what would end earlier
/// on it. A unit that fails leaves, its tasks go elsewhere.
///
/// Thread safe. The destructor cancels what has not begun and waits for what runs, callbacks included; what does not
/// come back within the hang timeout keeps its memory.
class Runtime
{
public:
  /// Finds the units. @throws std::invalid_argument for impossible options, std::runtime_error if no unit is left.
  explicit Runtime(const RuntimeOptions& options = RuntimeOptions());
  /// As above, but with executors of the caller's own beside or instead of the ones that options ask for.
  Runtime(const RuntimeOptions& options, std::vector<CustomUnit> units);
  ~Runtime();
  Runtime(const Runtime&) = delete;
  Runtime& operator=(const Runtime&) = delete;

  /// The runtime that the nodelets of one process share: made by the first call, with its options; ends with the last
  /// pointer.
  static std::shared_ptr<Runtime> shared(const RuntimeOptions& options = RuntimeOptions());

  /// Never blocks on the task. What is wrong with a request shows in the result (Outcome::REFUSED).
  TaskHandle submit(TaskRequest request);
  /// A metatask: independent tasks, placed together. The first to be started is not the first of the vector in general.
  std::vector<TaskHandle> submitBatch(std::vector<TaskRequest> requests);
  /// @return handles of the sub-tasks, in their order. Successors of a task that does not end well are cancelled.
  /// @throws std::invalid_argument if the edges are no acyclic graph; nothing is submitted then.
  std::vector<TaskHandle> submitGraph(GraphRequest request);

  /// Reserves capacity for a stream of jobs with deadlines on the unit where it fits best.
  Admission admit(const StreamRequest& request);
  /// Gives the capacity back. Unknown ids are ignored.
  void retire(StreamId id);
  std::vector<StreamStatus> streams() const;

  /// Runs the task on every unit and executor that can, first once (compilation, caches), then `runs` times for the ETC
  /// table. Blocks. The arguments' buffers are written as by any run.
  /// @return one result per unit and executor.
  std::vector<TaskResult> calibrate(const TaskRequest& request, int runs = 5);

  std::vector<UnitStatus> units() const;
  /// Takes a unit out (its tasks go elsewhere) or brings a failed one back; one that hangs comes back when it answers.
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

private:
  std::shared_ptr<RuntimeCore> core_;
};

}  // namespace pi_runtime
