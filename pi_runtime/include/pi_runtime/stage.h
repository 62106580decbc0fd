#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include <pi_runtime/runtime.h>

namespace pi_runtime
{

struct StageOptions
{
  std::string name;                      ///< of its stream: one word, as "slam_front_end"
  std::chrono::nanoseconds period{0};    ///< between two runs; 0: as measured
  std::chrono::nanoseconds deadline{0};  ///< of a run, after its call; 0: the period
  /// Longest processor time of a run; 0: as the ETC table has it (etc_file keeps it), else as measured.
  std::chrono::nanoseconds wcet{0};
};

struct StageStatus
{
  bool runtime = false;  ///< false: without a runtime, runs are plain calls
  std::string problem;   ///< why no capacity is reserved, with the figure that is missing; empty: it is
  uint64_t plain = 0;    ///< runs that the calling thread did, as no unit had begun them by their deadline
  double cpu_s = 0.0;    ///< processor time of all runs [s]; 0 without a runtime
  std::string ran_on;    ///< unit of the last run; empty: none
  double piece_s = 0.0;  ///< longest part of a run between two calls of yield() [s]
  StreamStatus stream;   ///< unit (empty: nothing is reserved), period, deadline, worst case, runs, misses, percentiles

  /// One line for diagnostics.
  std::string text() const;
};

/// A heavy stage of a service, as an admitted stream of jobs. The service wraps the work: `stage.run([&] { ... });`.
///
/// Each run is a native job on a unit's thread. Where the unit can interrupt nothing (UnitStatus::preemptive), a long
/// run is cut by Stage::yield(). The stage measures processor time and period of its first runs, which are plain calls.
/// Then it reserves capacity (Runtime::admit()), and again if a run takes longer or they come more often. A stage without
/// reserved capacity is behind all that have it. Its status says which figure is missing, and with which period it
/// would fit.
///
/// run() never fails because of the runtime: what no unit has begun by the deadline, or a unit did not end, is done by
/// the calling thread. Within the run of another stage, run() is a plain call.
class Stage
{
public:
  /// @param runtime  null: run() is a plain call.
  /// @throws std::invalid_argument for a name that is no word, or a negative time.
  Stage(std::shared_ptr<Runtime> runtime, const StageOptions& options);
  /// Gives the capacity back.
  ~Stage();
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

  /// Returns when the work is done. Exceptions of the work pass through. One thread at a time.
  void run(const std::function<void()>& work);
  /// For long work, to be called on its thread now and then, with no lock held that other stages take: if more urgent
  /// jobs wait for the unit, it does them here, on this thread. Any thread may call it at any time; costs 30 ns.
  static void yield();

  /// These from any thread.
  StageStatus status() const;
  double cpuSeconds() const;  ///< StageStatus::cpu_s alone, at less cost

private:
  struct Implementation;
  const std::unique_ptr<Implementation> implementation_;  ///< null: no runtime
};

}  // namespace pi_runtime
