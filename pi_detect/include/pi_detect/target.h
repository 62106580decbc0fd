#pragma once

#include <string>

namespace pi_detect
{

/// Where OpenCV runs a network.
enum class Target
{
  CPU,
  OPENCL,
  OPENCL_FP16,
};
const char* toString(Target target);  ///< "cpu", "opencl", "opencl_fp16"
/// @throws std::invalid_argument listing the valid names.
Target parseTarget(const std::string& name);

/// The target that OpenCV really uses: it falls back to the CPU if it does not support the OpenCL device, and reports
/// that on the error stream only.
struct TargetInUse
{
  Target requested = Target::CPU;
  Target used = Target::CPU;
  std::string device;  ///< OpenCL device in use; empty on the CPU
  std::string reason;  ///< why used is not what was requested, with the way out; empty if it is
  bool gpu = false;    ///< the device is a GPU
};
/// Predicts the target by the rules of OpenCV 4.6 (dnn.cpp, setUpNet()).
TargetInUse findTarget(Target requested);

}  // namespace pi_detect
