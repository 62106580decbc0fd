#include <pi_detect/target.h>

#include <cstdlib>
#include <opencv2/core/ocl.hpp>
#include <stdexcept>

namespace pi_detect
{
namespace
{

constexpr char ALLOW_ALL_DEVICES[] = "OPENCV_DNN_OPENCL_ALLOW_ALL_DEVICES";

/// As OpenCV reads its switches.
bool isSet(const char* name)
{
  const char* value = std::getenv(name);
  const std::string text = value == nullptr ? "" : value;
  return text == "1" || text == "true" || text == "True" || text == "TRUE";
}

}  // namespace

const char* toString(Target target)
{
  switch (target)
  {
    case Target::CPU:
      return "cpu";
    case Target::OPENCL:
      return "opencl";
    case Target::OPENCL_FP16:
      return "opencl_fp16";
  }
  return "?";
}

Target parseTarget(const std::string& name)
{
  for (const Target target : {Target::CPU, Target::OPENCL, Target::OPENCL_FP16})
  {
    if (name == toString(target))
    {
      return target;
    }
  }
  throw std::invalid_argument("target = \"" + name + "\", must be cpu, opencl or opencl_fp16");
}

TargetInUse findTarget(Target requested)
{
  TargetInUse result;
  result.requested = requested;
  if (requested == Target::CPU)
  {
    return result;
  }
  if (!cv::ocl::haveOpenCL() || !cv::ocl::useOpenCL())
  {
    result.reason =
        "OpenCV found no OpenCL device: install an OpenCL driver (as pocl-opencl-icd), and leave "
        "OPENCV_OPENCL_RUNTIME and OPENCV_OPENCL_DEVICE unset or name a device, as \":GPU:\"";
    return result;
  }
  const cv::ocl::Device& device = cv::ocl::Device::getDefault();
  const bool all_devices = isSet(ALLOW_ALL_DEVICES);
  if (device.type() != cv::ocl::Device::TYPE_GPU && !all_devices)
  {
    result.reason = "OpenCV runs networks on GPUs only, and \"" + device.name() +
                    "\" is none: start the process with " + ALLOW_ALL_DEVICES +
                    "=1 in its environment, or choose a GPU with OPENCV_OPENCL_DEVICE";
    return result;
  }
  result.used = requested;
  result.device = device.name();
  result.gpu = device.type() == cv::ocl::Device::TYPE_GPU;
  if (requested == Target::OPENCL_FP16 && !device.isIntel() && !all_devices)
  {
    result.used = Target::OPENCL;
    result.reason = "OpenCV runs FP16 on Intel's GPUs only, and \"" + device.name() +
                    "\" is none: start the process with " + ALLOW_ALL_DEVICES +
                    "=1 in its environment, or ask for opencl";
  }
  return result;
}

}  // namespace pi_detect
