#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <pi_runtime/executor.h>
#include <pi_runtime/inner_core_scheduler.h>
#include <pi_runtime/inter_core_scheduler.h>
#include <pi_runtime/opencl.h>

namespace pi_runtime
{

enum class LogLevel : uint8_t
{
  INFO,
  WARNING,
};

/// The order in which a unit takes tasks from its queue.
enum class QueueOrder : uint8_t
{
  EDF,   ///< deadlines first, the earliest at the head; then priorities, then as planned
  FIFO,  ///< as submitted, whatever the deadline: for comparison with a static map (π-Edge, section VII.B)
};
const char* toString(QueueOrder order);
/// @throws std::invalid_argument listing the valid names.
QueueOrder parseQueueOrder(const std::string& name);

/// Settings of one unit.
struct UnitTuning
{
  std::string unit;
  double active_power_w = 0.0;  ///< while it works, above idle; for the energy term
  double idle_power_w = 0.0;    ///< for reports
  /// Emulates a slower unit: it stays busy (slowdown - 1) times as long again after each task. For tests and studies of
  /// heterogeneity; >= 1.
  double slowdown = 1.0;
};

struct RuntimeOptions
{
  /// Cores of each CPU unit. Empty: one core each up to four units, then even shares. A unit of several cores runs
  /// OpenCL kernels on all of them, and native functions on one thread that may use all of them.
  std::vector<unsigned> cpu_units;
  bool native = true;      ///< CPU units run native functions
  bool opencl_cpu = true;  ///< CPU units run OpenCL (PoCL)
  bool opencl_gpu = true;  ///< GPUs and accelerators become units
  /// Memory model of CPU units. DIRECT is correct; the others are for tests.
  MemoryModel cpu_memory = MemoryModel::DIRECT;
  /// Pins the threads of CPU units, also PoCL's, to their cores. Isolates better from other programs, but a wake-up
  /// across cores takes longer (measured: 16 instead of 8 us for submit and wait).
  bool pin_threads = false;
  /// Where the kernel grants real-time priorities, short jobs of admitted streams run on threads of their own and
  /// interrupt what else the unit does; else nothing is interrupted. false: never.
  bool preemption = true;
  std::vector<UnitTuning> tuning;

  InterCoreOptions inter_core;
  InnerCoreOptions inner_core;
  QueueOrder queue_order = QueueOrder::EDF;
  bool stealing = true;
  /// A sliceable task with a longer expected time runs in slices of about this length.
  std::chrono::microseconds slice{5000};
  /// Small OpenCL tasks are enqueued behind a running task while their expected times add up to at most this.
  std::chrono::microseconds pipeline{200};
  /// A unit has failed if its task runs longer than this and longer than 20 times its prediction. The first run of a
  /// codelet on a unit may take six times this, since it may compile.
  std::chrono::milliseconds hang_timeout{10000};
  /// Share units with other processes of the user. @see UnitArbiter
  bool arbitration = true;
  std::string arbitration_folder = "/dev/shm";

  std::string
      etc_file;  ///< ETC table, read at the start if it is there, written at the end and now and then; empty: none
  std::string cache_folder = defaultCacheFolder();  ///< OpenCL programs built earlier; empty: none
  size_t trace_capacity = 0;                        ///< tasks that the trace keeps; 0: no trace

  /// Called without locks from any thread. Null: silent.
  std::function<void(LogLevel, const std::string&)> log;

  /// Of a service with native stages. @param opencl  false: without OpenCL, whose driver takes 70 MB.
  static RuntimeOptions forService(bool opencl = false);
  /// $XDG_CACHE_HOME/pi_runtime, else ~/.cache/pi_runtime, else none.
  static std::string defaultCacheFolder();
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A unit with executors of the caller: an accelerator without OpenCL, a fake in a test.
struct CustomUnit
{
  std::string name;
  UnitType type = UnitType::ACCELERATOR;
  std::vector<std::unique_ptr<Executor>> executors;
};

}  // namespace pi_runtime
