#pragma once

#ifndef CL_TARGET_OPENCL_VERSION
#define CL_TARGET_OPENCL_VERSION 120
#endif
#include <CL/cl.h>

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <pi_runtime/buffer.h>
#include <pi_runtime/codelet.h>

namespace pi_runtime
{

/// Name of an OpenCL error code, as "CL_OUT_OF_RESOURCES".
const char* openClErrorName(cl_int code);

/// A failed OpenCL call.
class OpenClError : public std::runtime_error
{
public:
  OpenClError(const std::string& what_failed, cl_int code, std::string build_log = "");
  cl_int code() const { return code_; }
  /// The compiler's output if a program did not build; else empty.
  const std::string& buildLog() const { return build_log_; }
  /// True if the code means that the device is lost, not that the call was wrong.
  bool deviceLost() const;

private:
  cl_int code_;
  std::string build_log_;
};

/// Throws OpenClError("<what>: ...") unless code is CL_SUCCESS.
void checkOpenCl(cl_int code, const std::string& what);

/// Owner of one reference to an OpenCL object.
template <typename T, cl_int (*RELEASE)(T)>
class ClHandle
{
public:
  ClHandle() = default;
  explicit ClHandle(T object) : object_(object) {}
  ClHandle(ClHandle&& other) noexcept : object_(std::exchange(other.object_, nullptr)) {}
  ClHandle& operator=(ClHandle&& other) noexcept
  {
    std::swap(object_, other.object_);
    return *this;
  }
  ~ClHandle()
  {
    if (object_ != nullptr)
    {
      RELEASE(object_);
    }
  }
  T get() const { return object_; }

private:
  T object_ = nullptr;
};
using ClContext = ClHandle<cl_context, clReleaseContext>;
using ClDevice = ClHandle<cl_device_id, clReleaseDevice>;
using ClQueue = ClHandle<cl_command_queue, clReleaseCommandQueue>;
using ClProgram = ClHandle<cl_program, clReleaseProgram>;
using ClKernel = ClHandle<cl_kernel, clReleaseKernel>;
using ClMem = ClHandle<cl_mem, clReleaseMemObject>;
using ClEvent = ClHandle<cl_event, clReleaseEvent>;

/// An OpenCL device of an installed platform, before it is used.
struct OpenClDeviceInfo
{
  cl_platform_id platform;
  cl_device_id device;
  std::string platform_name;
  std::string name;
  std::string driver;
  UnitType type;
  unsigned compute_units;
  bool unified_memory;  ///< shares the host's memory
  bool fp16;
  bool fp64;
};

/// The usable devices of all platforms, in the order of the ICD loader; empty without OpenCL.
/// @param[out] problems  one line per platform or device that cannot be used, with the reason; may be null.
std::vector<OpenClDeviceInfo> findOpenClDevices(std::vector<std::string>* problems);

/// How the units of a context share memory with the host.
enum class MemoryModel : uint8_t
{
  DIRECT,    ///< the host's memory itself, coherent without any call (CPUs)
  MAPPED,    ///< the host's memory, handed over by map and unmap (integrated GPUs)
  SEPARATE,  ///< memory of its own; bytes are moved
};
const char* toString(MemoryModel model);

/// One context: a device, or the sub-devices of one. Shared by their units; thread safe.
class OpenClContext
{
public:
  /// @param counts  compute units of each sub-device; empty: the device as a whole.
  /// @param model  DIRECT is right for CPUs only.
  /// @throws OpenClError
  OpenClContext(const OpenClDeviceInfo& info, const std::vector<unsigned>& counts, MemoryModel model);

  const OpenClDeviceInfo& info() const { return info_; }
  MemoryModel memoryModel() const { return model_; }
  cl_context get() const { return context_.get(); }
  cl_device_id device(size_t index) const { return devices_.at(index).get(); }
  /// An in-order queue. @throws OpenClError
  ClQueue makeQueue(size_t device) const;

private:
  OpenClDeviceInfo info_;
  MemoryModel model_;
  std::vector<ClDevice> devices_;
  ClContext context_;
};

/// A program built for one device, with its kernels. Not thread safe: each unit has its own.
class OpenClProgram
{
public:
  /// Builds, or loads a binary built earlier.
  /// @param cache_folder  where binaries are kept, by a hash of source, options, device and driver; empty: nowhere.
  /// @throws OpenClError with the build log.
  OpenClProgram(const OpenClContext& context, size_t device, const OpenClImplementation& implementation,
                const std::string& cache_folder);

  /// @throws OpenClError (CL_INVALID_KERNEL_NAME) if the program has none of this name.
  cl_kernel kernel(const std::string& name);
  /// True if the program came from the cache.
  bool fromCache() const { return from_cache_; }

private:
  bool loadBinary(const std::string& path, const std::string& options);
  void saveBinary(const std::string& path) const;

  cl_context context_;
  cl_device_id device_;
  ClProgram program_;
  bool from_cache_ = false;
  std::map<std::string, ClKernel> kernels_;
};

}  // namespace pi_runtime
