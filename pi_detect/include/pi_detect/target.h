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

/// What OpenCV makes of a wish: it goes to the CPU by itself where it does not like the OpenCL device, and only says so
/// on the error stream.
struct TargetInUse
{
  Target requested = Target::CPU;
  Target used = Target::CPU;
  std::string device;  ///< OpenCL device in use; empty on the CPU
  std::string reason;  ///< why used is not what was requested, with the way out; empty if it is
  bool gpu = false;    ///< the device is a GPU
};
/// By the rules of OpenCV 4.6 (dnn.cpp, setUpNet()), before a network is set up.
TargetInUse findTarget(Target requested);

}  // namespace pi_detect
