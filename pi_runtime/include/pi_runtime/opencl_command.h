#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <pi_runtime/codelet.h>
#include <pi_runtime/opencl.h>

namespace pi_runtime
{

/// Global and local size of a kernel, one to three dimensions.
struct NdRange
{
  NdRange(size_t global, size_t local) : dimensions(1), global{global, 1, 1}, local{local, 1, 1} {}
  NdRange(size_t global_x, size_t global_y, size_t local_x, size_t local_y)
    : dimensions(2), global{global_x, global_y, 1}, local{local_x, local_y, 1}
  {
  }
  NdRange& offset(size_t x, size_t y = 0)
  {
    first[0] = x;
    first[1] = y;
    return *this;
  }

  cl_uint dimensions;
  size_t global[3];
  size_t local[3];
  size_t first[3] = {0, 0, 0};
};

/// Local memory of a kernel, as its argument.
struct LocalMemory
{
  size_t bytes;
};

/// The call of an OpenCL implementation: its arguments as memory objects of the unit, and the unit's queue.
///
/// Kernels run in the order in which they are enqueued. The local size must be given: PoCL compiles a kernel again for
/// each new local size (28 to 140 ms).
class OpenClCommand : public TaskArguments
{
public:
  OpenClCommand(OpenClProgram& program, cl_command_queue queue, const std::vector<Argument>& arguments,
                const std::vector<cl_mem>& memory, uint64_t begin, uint64_t end, uint64_t range);
  ~OpenClCommand();
  OpenClCommand(const OpenClCommand&) = delete;
  OpenClCommand& operator=(const OpenClCommand&) = delete;

  /// Memory object of the buffer at index. @throws std::invalid_argument if it is no buffer.
  cl_mem buffer(size_t index) const;

  /// Enqueues one kernel of the program.
  /// @param arguments  cl_mem, LocalMemory, or plain values of the types that the kernel declares.
  /// @throws OpenClError naming kernel and argument.
  template <typename... Arguments>
  void enqueue(const std::string& kernel, const NdRange& range, const Arguments&... arguments)
  {
    const cl_kernel object = program_.kernel(kernel);
    cl_uint index = 0;
    (setArgument(object, kernel, index++, arguments), ...);
    launch(object, kernel, range);
  }
  /// Enqueues a kernel that takes all arguments of the task in their order.
  void enqueueAll(const std::string& kernel, const NdRange& range);

  /// The event of the newest kernel, null if there is none. The caller must release it.
  cl_event takeLastEvent();

private:
  template <typename T>
  void setArgument(cl_kernel object, const std::string& kernel, cl_uint index, const T& value)
  {
    setRawArgument(object, kernel, index, sizeof(T), &value);
  }
  void setArgument(cl_kernel object, const std::string& kernel, cl_uint index, const LocalMemory& local)
  {
    setRawArgument(object, kernel, index, local.bytes, nullptr);
  }
  void setRawArgument(cl_kernel object, const std::string& kernel, cl_uint index, size_t bytes, const void* value);
  void launch(cl_kernel object, const std::string& kernel, const NdRange& range);

  OpenClProgram& program_;
  cl_command_queue queue_;
  const std::vector<cl_mem>& memory_;
  cl_event last_ = nullptr;
};

/// An implementation of one kernel that takes all arguments of the task: one work item per element of its range, which
/// must be a multiple of local.
OpenClImplementation singleKernel(std::string source, std::string kernel, size_t local, std::string options = "");

}  // namespace pi_runtime
