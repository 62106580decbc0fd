#pragma once

#include <algorithm>
#include <atomic>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "units/native_executor.h"
#include "opencl/opencl_executor.h"

namespace pi_runtime
{

/// Runs codelets at once, without a scheduler: on this thread, or on the first compute unit of PoCL.
class CodeletRunner
{
public:
  /// One for all tests of a program: finding PoCL takes a while.
  static CodeletRunner& shared()
  {
    static CodeletRunner instance;
    return instance;
  }

  CodeletRunner()
  {
    for (const OpenClDeviceInfo& info : findOpenClDevices(nullptr))
    {
      if (info.type == UnitType::CPU)
      {
        const std::vector<unsigned> counts =
            info.compute_units > 1 ? std::vector<unsigned>{1} : std::vector<unsigned>{};
        const auto context = std::make_shared<OpenClContext>(info, counts, MemoryModel::DIRECT);
        opencl_ = std::make_unique<OpenClExecutor>(context, 0, "");
        return;
      }
    }
    throw std::runtime_error("no OpenCL CPU device (Debian: pocl-opencl-icd)");
  }

  void native(const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range)
  {
    run(native_, codelet, arguments, 0, range, range);
  }
  void opencl(const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range)
  {
    run(*opencl_, codelet, arguments, 0, range, range);
  }
  /// As native() and opencl(), but in slices of the given size, which is a multiple of the codelet's granularity.
  void nativeSliced(const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range, uint64_t slice)
  {
    sliced(native_, codelet, arguments, range, slice);
  }
  void openclSliced(const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range, uint64_t slice)
  {
    sliced(*opencl_, codelet, arguments, range, slice);
  }

private:
  void sliced(Executor& executor, const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range,
              uint64_t slice)
  {
    for (uint64_t begin = 0; begin < range; begin += slice)
    {
      run(executor, codelet, arguments, begin, std::min(range, begin + slice), range);
    }
  }

  void run(Executor& executor, const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t begin,
           uint64_t end, uint64_t range)
  {
    const std::atomic<bool> cancelled{false};
    std::promise<ExecutionReport> promise;
    executor.start(Execution{codelet, arguments, begin, end, range, &cancelled},
                   [&promise](const ExecutionReport& report) { promise.set_value(report); });
    const ExecutionReport report = promise.get_future().get();
    if (report.outcome != Outcome::OK)
    {
      throw std::runtime_error(codelet->name + ": " + toString(report.outcome) + ": " + report.message);
    }
  }

  NativeExecutor native_{UnitType::CPU};
  std::unique_ptr<OpenClExecutor> opencl_;
};

}  // namespace pi_runtime
