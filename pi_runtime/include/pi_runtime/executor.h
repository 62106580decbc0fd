#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <pi_runtime/codelet.h>

namespace pi_runtime
{

/// How a task ended.
enum class Outcome : uint8_t
{
  OK,
  CANCELLED,         ///< by the caller, or because a task that it depends on did not end well
  REFUSED,           ///< no unit can run it without breaking admitted deadlines
  BUILD_FAILED,      ///< its OpenCL program does not compile, and there is no other implementation
  EXECUTION_FAILED,  ///< an OpenCL call failed, or its function threw
  UNIT_FAILED,       ///< its unit failed, and no other unit can run it
  SHUT_DOWN,         ///< the runtime ended first
};
const char* toString(Outcome outcome);

/// One piece of work for an executor. Everything in it outlives the execution.
struct Execution
{
  const CodeletPtr& codelet;
  const std::vector<Argument>& arguments;
  uint64_t begin;
  uint64_t end;
  uint64_t range;
  const std::atomic<bool>* cancelled;

  /// How this slice uses a buffer. Later slices need what the earlier ones wrote, which may have run on another unit.
  Access accessOf(const Argument& argument) const
  {
    return begin != 0 && argument.access() == Access::WRITE ? Access::READ_WRITE : argument.access();
  }
};

struct ExecutionReport
{
  Outcome outcome = Outcome::OK;
  int opencl_code = 0;      ///< of the call that failed; 0 if none did
  std::string message;      ///< what failed, with the build log; empty if OK
  int64_t transfer_ns = 0;  ///< time spent on moving buffers in front of the run
  uint64_t moved_bytes = 0;
};

/// Runs one kind of implementation on one unit, one execution after the other.
///
/// The runtime calls prepare() and start() from one thread at a time; the rest is thread safe. tryOut() runs beside
/// them, for another codelet.
class Executor
{
public:
  using Completion = std::function<void(const ExecutionReport&)>;
  virtual ~Executor() = default;

  /// "native", "opencl": column of the ETC table.
  virtual const char* name() const = 0;
  virtual bool supports(const Codelet& codelet) const = 0;
  /// True if start() returns at once and completion comes from another thread. The submitting thread then starts tasks.
  virtual bool asynchronous() const = 0;
  /// True if start() will not compile or move anything first.
  virtual bool ready(const Execution& execution) const = 0;
  /// Compiles and loads; may take seconds. @throws OpenClError, std::invalid_argument
  virtual void prepare(const CodeletPtr& codelet) = 0;
  /// True if the first run of a codelet takes long, since it is compiled. The runtime then tries a codelet out in the
  /// background, before it uses this executor for what another one can run.
  virtual bool compiles() const { return false; }
  /// Compiles, and runs the codelet beside what the unit does, until nothing is compiled any more. The arguments are
  /// memory of its own. @return run time of the last run [s]. @throws as prepare(), and what the function throws.
  virtual double tryOut(const Execution&) { return 0.0; }
  /// Begins an execution; completion is called exactly once, from any thread, perhaps before start() returns.
  virtual void start(const Execution& execution, Completion completion) = 0;
  /// The unit's memory if it is not the host's.
  virtual const MemorySpace* memory() const { return nullptr; }
  /// Measures the bandwidth to the unit and back [B/s]; infinite where memory is shared.
  virtual double measureBandwidth() = 0;
};

/// The report for the exception in flight. Call inside a catch block only.
ExecutionReport reportOfCurrentException();

}  // namespace pi_runtime
