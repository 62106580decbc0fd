#include <pi_runtime/executor.h>

#include <exception>

#include <pi_runtime/opencl.h>

namespace pi_runtime
{

const char* toString(Outcome outcome)
{
  static constexpr const char* NAMES[] = {"ok",          "cancelled", "refused", "build failed", "execution failed",
                                          "unit failed", "shut down"};
  return NAMES[static_cast<size_t>(outcome)];
}

ExecutionReport reportOfCurrentException()
{
  ExecutionReport report;
  try
  {
    throw;
  }
  catch (const OpenClError& error)
  {
    report.opencl_code = error.code();
    report.message = error.what();
    // A program without one of its kernels is as useless as one that does not compile.
    const bool no_kernel = error.code() == CL_INVALID_KERNEL_NAME || error.code() == CL_INVALID_KERNEL_DEFINITION;
    report.outcome = error.deviceLost()                       ? Outcome::UNIT_FAILED
                     : !error.buildLog().empty() || no_kernel ? Outcome::BUILD_FAILED
                                                              : Outcome::EXECUTION_FAILED;
    if (!error.buildLog().empty())
    {
      report.message += "\n" + error.buildLog();
    }
  }
  catch (const std::exception& error)
  {
    report.outcome = Outcome::EXECUTION_FAILED;
    report.message = error.what();
  }
  catch (...)
  {
    report.outcome = Outcome::EXECUTION_FAILED;
    report.message = "threw something that is no std::exception";
  }
  return report;
}

}  // namespace pi_runtime
