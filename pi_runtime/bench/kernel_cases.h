#pragma once

#include <functional>
#include <string>
#include <vector>

#include "codelet_runner.h"

namespace pi_runtime
{

/// One kernel on one typical input, ready to run three ways.
struct KernelCase
{
  std::string name;  ///< "fast_corners 640x480"
  std::function<void()> native;
  std::function<void()> opencl;
  std::function<void()> opencv;  ///< empty where OpenCV has no equivalent
};

/// Cases share the runner, which must outlive them.
std::vector<KernelCase> frontEndCases(CodeletRunner& runner);
std::vector<KernelCase> descriptorCases(CodeletRunner& runner);
std::vector<KernelCase> imageCases(CodeletRunner& runner);

}  // namespace pi_runtime
