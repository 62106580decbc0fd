#include <pi_runtime/executor.h>

#include <exception>

#include <pi_runtime/opencl.h>

namespace pi_runtime
{

const char* toString(Outcome outcome)
{
  switch (outcome)
  {
    case Outcome::OK:
      return "ok";
    case Outcome::CANCELLED:
      return "cancelled";
    case Outcome::REFUSED:
      return "refused";
    case Outcome::BUILD_FAILED:
      return "build failed";
    case Outcome::EXECUTION_FAILED:
      return "execution failed";
    case Outcome::UNIT_FAILED:
      return "unit failed";
    case Outcome::SHUT_DOWN:
      return "shut down";
  }
  return "unknown";
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
