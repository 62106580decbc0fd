#include "units/native_executor.h"

#include <chrono>
#include <limits>

namespace pi_runtime
{

bool NativeExecutor::supports(const Codelet& codelet) const
{
  return !codelet.native.empty() && (codelet.native.front().unit_types & static_cast<uint8_t>(type_)) != 0;
}

void NativeExecutor::start(const Execution& execution, Completion completion)
{
  ExecutionReport report;
  try
  {
    for (const Argument& argument : execution.arguments)
    {
      if (!argument.isBuffer())
      {
        continue;
      }
      const Access access = execution.accessOf(argument);
      const size_t bytes = argument.buffer()->bytesToMove(nullptr, access);
      const auto begin = std::chrono::steady_clock::now();
      argument.buffer()->host(access);
      if (bytes != 0)
      {
        report.moved_bytes += bytes;
        report.transfer_ns += (std::chrono::steady_clock::now() - begin) / std::chrono::nanoseconds(1);
      }
    }
    execution.codelet->native.front().function(
        NativeCall(execution.arguments, execution.begin, execution.end, execution.range, execution.cancelled));
  }
  catch (...)
  {
    report = reportOfCurrentException();
  }
  completion(report);
}

double NativeExecutor::measureBandwidth()
{
  return std::numeric_limits<double>::infinity();
}

}  // namespace pi_runtime
