#include <pi_runtime/opencl.h>

#include <pi_node/fnv1a.h>

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string_view>
#include <system_error>

namespace pi_runtime
{
namespace
{

namespace fs = std::filesystem;

struct NamedCode
{
  cl_int code;
  const char* name;
};
#define PI_RUNTIME_NAMED(code) \
  {                            \
    code, #code                \
  }
constexpr NamedCode CODES[] = {
    PI_RUNTIME_NAMED(CL_SUCCESS),
    PI_RUNTIME_NAMED(CL_DEVICE_NOT_FOUND),
    PI_RUNTIME_NAMED(CL_DEVICE_NOT_AVAILABLE),
    PI_RUNTIME_NAMED(CL_COMPILER_NOT_AVAILABLE),
    PI_RUNTIME_NAMED(CL_MEM_OBJECT_ALLOCATION_FAILURE),
    PI_RUNTIME_NAMED(CL_OUT_OF_RESOURCES),
    PI_RUNTIME_NAMED(CL_OUT_OF_HOST_MEMORY),
    PI_RUNTIME_NAMED(CL_MEM_COPY_OVERLAP),
    PI_RUNTIME_NAMED(CL_BUILD_PROGRAM_FAILURE),
    PI_RUNTIME_NAMED(CL_MAP_FAILURE),
    PI_RUNTIME_NAMED(CL_MISALIGNED_SUB_BUFFER_OFFSET),
    PI_RUNTIME_NAMED(CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST),
    PI_RUNTIME_NAMED(CL_COMPILE_PROGRAM_FAILURE),
    PI_RUNTIME_NAMED(CL_LINKER_NOT_AVAILABLE),
    PI_RUNTIME_NAMED(CL_LINK_PROGRAM_FAILURE),
    PI_RUNTIME_NAMED(CL_DEVICE_PARTITION_FAILED),
    PI_RUNTIME_NAMED(CL_KERNEL_ARG_INFO_NOT_AVAILABLE),
    PI_RUNTIME_NAMED(CL_INVALID_VALUE),
    PI_RUNTIME_NAMED(CL_INVALID_DEVICE_TYPE),
    PI_RUNTIME_NAMED(CL_INVALID_PLATFORM),
    PI_RUNTIME_NAMED(CL_INVALID_DEVICE),
    PI_RUNTIME_NAMED(CL_INVALID_CONTEXT),
    PI_RUNTIME_NAMED(CL_INVALID_QUEUE_PROPERTIES),
    PI_RUNTIME_NAMED(CL_INVALID_COMMAND_QUEUE),
    PI_RUNTIME_NAMED(CL_INVALID_HOST_PTR),
    PI_RUNTIME_NAMED(CL_INVALID_MEM_OBJECT),
    PI_RUNTIME_NAMED(CL_INVALID_BINARY),
    PI_RUNTIME_NAMED(CL_INVALID_BUILD_OPTIONS),
    PI_RUNTIME_NAMED(CL_INVALID_PROGRAM),
    PI_RUNTIME_NAMED(CL_INVALID_PROGRAM_EXECUTABLE),
    PI_RUNTIME_NAMED(CL_INVALID_KERNEL_NAME),
    PI_RUNTIME_NAMED(CL_INVALID_KERNEL_DEFINITION),
    PI_RUNTIME_NAMED(CL_INVALID_KERNEL),
    PI_RUNTIME_NAMED(CL_INVALID_ARG_INDEX),
    PI_RUNTIME_NAMED(CL_INVALID_ARG_VALUE),
    PI_RUNTIME_NAMED(CL_INVALID_ARG_SIZE),
    PI_RUNTIME_NAMED(CL_INVALID_KERNEL_ARGS),
    PI_RUNTIME_NAMED(CL_INVALID_WORK_DIMENSION),
    PI_RUNTIME_NAMED(CL_INVALID_WORK_GROUP_SIZE),
    PI_RUNTIME_NAMED(CL_INVALID_WORK_ITEM_SIZE),
    PI_RUNTIME_NAMED(CL_INVALID_GLOBAL_OFFSET),
    PI_RUNTIME_NAMED(CL_INVALID_EVENT_WAIT_LIST),
    PI_RUNTIME_NAMED(CL_INVALID_EVENT),
    PI_RUNTIME_NAMED(CL_INVALID_OPERATION),
    PI_RUNTIME_NAMED(CL_INVALID_BUFFER_SIZE),
    PI_RUNTIME_NAMED(CL_INVALID_GLOBAL_WORK_SIZE),
    PI_RUNTIME_NAMED(CL_INVALID_PROPERTY),
    PI_RUNTIME_NAMED(CL_INVALID_COMPILER_OPTIONS),
    PI_RUNTIME_NAMED(CL_INVALID_LINKER_OPTIONS),
    PI_RUNTIME_NAMED(CL_INVALID_DEVICE_PARTITION_COUNT),
    {-1001, "CL_PLATFORM_NOT_FOUND_KHR"},
};
#undef PI_RUNTIME_NAMED

template <typename T>
T deviceValue(cl_device_id device, cl_device_info what)
{
  T value{};
  checkOpenCl(clGetDeviceInfo(device, what, sizeof value, &value, nullptr), "clGetDeviceInfo");
  return value;
}

std::string deviceText(cl_device_id device, cl_device_info what)
{
  size_t bytes = 0;
  checkOpenCl(clGetDeviceInfo(device, what, 0, nullptr, &bytes), "clGetDeviceInfo");
  std::string text(bytes, '\0');
  checkOpenCl(clGetDeviceInfo(device, what, bytes, &text[0], nullptr), "clGetDeviceInfo");
  return text.c_str();
}

UnitType typeOf(cl_device_type type)
{
  if ((type & CL_DEVICE_TYPE_CPU) != 0)
  {
    return UnitType::CPU;
  }
  return (type & CL_DEVICE_TYPE_GPU) != 0 ? UnitType::GPU : UnitType::ACCELERATOR;
}

OpenClDeviceInfo describe(cl_platform_id platform, const std::string& platform_name, cl_device_id device)
{
  OpenClDeviceInfo info;
  info.platform = platform;
  info.device = device;
  info.platform_name = platform_name;
  info.name = deviceText(device, CL_DEVICE_NAME);
  info.driver = deviceText(device, CL_DRIVER_VERSION);
  info.type = typeOf(deviceValue<cl_device_type>(device, CL_DEVICE_TYPE));
  info.compute_units = deviceValue<cl_uint>(device, CL_DEVICE_MAX_COMPUTE_UNITS);
  info.unified_memory = deviceValue<cl_bool>(device, CL_DEVICE_HOST_UNIFIED_MEMORY) == CL_TRUE;
  const std::string extensions = deviceText(device, CL_DEVICE_EXTENSIONS);
  info.fp16 = extensions.find("cl_khr_fp16") != std::string::npos;
  info.fp64 = deviceValue<cl_device_fp_config>(device, CL_DEVICE_DOUBLE_FP_CONFIG) != 0;
  return info;
}

void findOnPlatform(cl_platform_id platform, std::vector<OpenClDeviceInfo>* found, std::vector<std::string>* problems)
{
  char name[256] = "";
  clGetPlatformInfo(platform, CL_PLATFORM_NAME, sizeof name - 1, name, nullptr);
  try
  {
    cl_uint count = 0;
    const cl_int code = clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 0, nullptr, &count);
    if (code == CL_DEVICE_NOT_FOUND)
    {
      return;
    }
    checkOpenCl(code, "clGetDeviceIDs");
    std::vector<cl_device_id> devices(count);
    checkOpenCl(clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, count, devices.data(), nullptr), "clGetDeviceIDs");
    for (const cl_device_id device : devices)
    {
      if (deviceValue<cl_bool>(device, CL_DEVICE_AVAILABLE) == CL_TRUE &&
          deviceValue<cl_bool>(device, CL_DEVICE_COMPILER_AVAILABLE) == CL_TRUE)
      {
        found->push_back(describe(platform, name, device));
      }
      else if (problems != nullptr)
      {
        problems->push_back("OpenCL device " + deviceText(device, CL_DEVICE_NAME) + " of " + name +
                            " is not available or has no compiler");
      }
    }
  }
  catch (const OpenClError& error)
  {
    if (problems != nullptr)
    {
      problems->push_back("OpenCL platform " + std::string(name) + ": " + error.what());
    }
  }
}

/// Stands in front of a binary in the cache, as drivers need not survive a damaged one (PoCL 3.1 ends the process).
std::string sealOf(std::string_view binary)
{
  const uint64_t hash = pi_node::fnv1a(binary);
  return std::string(reinterpret_cast<const char*>(&hash), sizeof hash);
}

std::string cacheFileName(const OpenClContext& context, size_t device, const OpenClImplementation& implementation)
{
  const std::string key = implementation.source + '\0' + implementation.options + '\0' + context.info().platform_name +
                          '\0' + context.info().name + '\0' + context.info().driver + '\0' +
                          std::to_string(deviceValue<cl_uint>(context.device(device), CL_DEVICE_MAX_COMPUTE_UNITS));
  char name[32];
  std::snprintf(name, sizeof name, "%016llx.clbin", static_cast<unsigned long long>(pi_node::fnv1a(key)));
  return name;
}

}  // namespace

const char* openClErrorName(cl_int code)
{
  for (const NamedCode& named : CODES)
  {
    if (named.code == code)
    {
      return named.name;
    }
  }
  return "unknown OpenCL error";
}

OpenClError::OpenClError(const std::string& what_failed, cl_int code, std::string build_log)
  : std::runtime_error(what_failed + " failed: " + openClErrorName(code) + " (" + std::to_string(code) + ")")
  , code_(code)
  , build_log_(std::move(build_log))
{
}

bool OpenClError::deviceLost() const
{
  return code_ == CL_DEVICE_NOT_AVAILABLE || code_ == CL_OUT_OF_RESOURCES || code_ == CL_INVALID_COMMAND_QUEUE ||
         code_ == CL_INVALID_CONTEXT || code_ == CL_INVALID_DEVICE || code_ == CL_DEVICE_NOT_FOUND ||
         code_ == CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST;
}

void checkOpenCl(cl_int code, const std::string& what)
{
  if (code != CL_SUCCESS)
  {
    throw OpenClError(what, code);
  }
}

const char* toString(MemoryModel model)
{
  static constexpr const char* NAMES[] = {"direct", "mapped", "separate"};
  return NAMES[static_cast<size_t>(model)];
}

std::vector<OpenClDeviceInfo> findOpenClDevices(std::vector<std::string>* problems)
{
  std::vector<OpenClDeviceInfo> found;
  cl_uint count = 0;
  const cl_int code = clGetPlatformIDs(0, nullptr, &count);
  if (code != CL_SUCCESS || count == 0)
  {
    if (problems != nullptr)
    {
      problems->push_back("no OpenCL platform is installed (Debian: pocl-opencl-icd); native implementations only");
    }
    return found;
  }
  std::vector<cl_platform_id> platforms(count);
  checkOpenCl(clGetPlatformIDs(count, platforms.data(), nullptr), "clGetPlatformIDs");
  for (const cl_platform_id platform : platforms)
  {
    findOnPlatform(platform, &found, problems);
  }
  return found;
}

OpenClContext::OpenClContext(const OpenClDeviceInfo& info, const std::vector<unsigned>& counts, MemoryModel model)
  : info_(info), model_(model)
{
  std::vector<cl_device_id> ids;
  if (counts.empty())
  {
    ids = {info.device};
  }
  else
  {
    std::vector<cl_device_partition_property> properties = {CL_DEVICE_PARTITION_BY_COUNTS};
    properties.insert(properties.end(), counts.begin(), counts.end());
    properties.push_back(CL_DEVICE_PARTITION_BY_COUNTS_LIST_END);
    properties.push_back(0);
    ids.resize(counts.size());
    checkOpenCl(
        clCreateSubDevices(info.device, properties.data(), static_cast<cl_uint>(ids.size()), ids.data(), nullptr),
        "clCreateSubDevices of " + info.name);
    for (const cl_device_id id : ids)
    {
      devices_.emplace_back(id);
    }
  }
  if (counts.empty())
  {
    devices_.emplace_back(info.device);  // releasing a root device does nothing
  }
  cl_int code = CL_SUCCESS;
  context_ = ClContext(clCreateContext(nullptr, static_cast<cl_uint>(ids.size()), ids.data(), nullptr, nullptr, &code));
  checkOpenCl(code, "clCreateContext on " + info.name);
}

ClQueue OpenClContext::makeQueue(size_t device) const
{
  cl_int code = CL_SUCCESS;
  ClQueue queue(clCreateCommandQueue(context_.get(), this->device(device), 0, &code));
  checkOpenCl(code, "clCreateCommandQueue on " + info_.name);
  return queue;
}

OpenClProgram::OpenClProgram(const OpenClContext& context, size_t device, const OpenClImplementation& implementation,
                             const std::string& cache_folder)
  : context_(context.get()), device_(context.device(device))
{
  const std::string path =
      cache_folder.empty() ? "" : cache_folder + "/" + cacheFileName(context, device, implementation);
  if (!path.empty() && loadBinary(path, implementation.options))
  {
    from_cache_ = true;
    return;
  }
  const char* source = implementation.source.c_str();
  cl_int code = CL_SUCCESS;
  program_ = ClProgram(clCreateProgramWithSource(context_, 1, &source, nullptr, &code));
  checkOpenCl(code, "clCreateProgramWithSource");
  code = clBuildProgram(program_.get(), 1, &device_, implementation.options.c_str(), nullptr, nullptr);
  if (code != CL_SUCCESS)
  {
    size_t bytes = 0;
    clGetProgramBuildInfo(program_.get(), device_, CL_PROGRAM_BUILD_LOG, 0, nullptr, &bytes);
    std::string log(bytes, '\0');
    clGetProgramBuildInfo(program_.get(), device_, CL_PROGRAM_BUILD_LOG, bytes, &log[0], nullptr);
    log = log.c_str();
    throw OpenClError("building an OpenCL program", code, log.empty() ? "the compiler said nothing" : log);
  }
  if (!path.empty())
  {
    saveBinary(path);
  }
}

bool OpenClProgram::loadBinary(const std::string& path, const std::string& options)
{
  std::ifstream file(path, std::ios::binary);
  if (!file)
  {
    return false;
  }
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const std::string_view binary = std::string_view(bytes).substr(std::min(bytes.size(), sizeof(uint64_t)));
  if (binary.empty() || bytes.compare(0, sizeof(uint64_t), sealOf(binary)) != 0)
  {
    return false;
  }
  const auto* data = reinterpret_cast<const unsigned char*>(binary.data());
  const size_t size = binary.size();
  cl_int status = CL_SUCCESS;
  cl_int code = CL_SUCCESS;
  ClProgram program(clCreateProgramWithBinary(context_, 1, &device_, &size, &data, &status, &code));
  // A damaged or foreign file is no error: the source is there.
  if (code != CL_SUCCESS || status != CL_SUCCESS ||
      clBuildProgram(program.get(), 1, &device_, options.c_str(), nullptr, nullptr) != CL_SUCCESS)
  {
    return false;
  }
  program_ = std::move(program);
  return true;
}

void OpenClProgram::saveBinary(const std::string& path) const
{
  // A context may have more devices than the program was built for: their binaries are empty. PoCL names the device
  // that the sub-devices belong to in their place.
  cl_uint count = 0;
  clGetProgramInfo(program_.get(), CL_PROGRAM_NUM_DEVICES, sizeof count, &count, nullptr);
  std::vector<cl_device_id> devices(count);
  std::vector<size_t> sizes(count);
  if (clGetProgramInfo(program_.get(), CL_PROGRAM_DEVICES, count * sizeof(cl_device_id), devices.data(), nullptr) !=
          CL_SUCCESS ||
      clGetProgramInfo(program_.get(), CL_PROGRAM_BINARY_SIZES, count * sizeof(size_t), sizes.data(), nullptr) !=
          CL_SUCCESS)
  {
    return;
  }
  std::vector<std::vector<unsigned char>> binaries(count);
  std::vector<unsigned char*> pointers(count);
  for (cl_uint index = 0; index < count; ++index)
  {
    binaries[index].resize(sizes[index]);
    pointers[index] = binaries[index].data();
  }
  if (clGetProgramInfo(program_.get(), CL_PROGRAM_BINARIES, count * sizeof(unsigned char*), pointers.data(), nullptr) !=
      CL_SUCCESS)
  {
    return;
  }
  for (cl_uint index = 0; index < count; ++index)
  {
    if ((count > 1 && devices[index] != device_) || binaries[index].empty())
    {
      continue;
    }
    // Another process may read or write the same file: it appears complete or not at all. Failures cost only time.
    std::error_code ignored;
    fs::create_directories(fs::path(path).parent_path(), ignored);
    const std::string part = path + "." + std::to_string(getpid());
    std::ofstream file(part, std::ios::binary);
    const std::string_view binary(reinterpret_cast<const char*>(binaries[index].data()), sizes[index]);
    file << sealOf(binary) << binary;
    file.close();
    if (file)
    {
      fs::rename(part, path, ignored);
    }
    fs::remove(part, ignored);
  }
}

cl_kernel OpenClProgram::kernel(const std::string& name)
{
  const auto found = kernels_.find(name);
  if (found != kernels_.end())
  {
    return found->second.get();
  }
  cl_int code = CL_SUCCESS;
  ClKernel kernel(clCreateKernel(program_.get(), name.c_str(), &code));
  checkOpenCl(code, "creating kernel " + name);
  return kernels_.emplace(name, std::move(kernel)).first->second.get();
}

}  // namespace pi_runtime
