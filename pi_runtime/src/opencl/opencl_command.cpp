#include <pi_runtime/opencl_command.h>

#include <utility>

namespace pi_runtime
{

OpenClCommand::OpenClCommand(OpenClProgram& program, cl_command_queue queue, const std::vector<Argument>& arguments,
                             const std::vector<cl_mem>& memory, uint64_t begin, uint64_t end, uint64_t range)
  : TaskArguments(arguments, begin, end, range), program_(program), queue_(queue), memory_(memory)
{
}

OpenClCommand::~OpenClCommand()
{
  if (last_ != nullptr)
  {
    clReleaseEvent(last_);
  }
}

cl_mem OpenClCommand::buffer(size_t index) const
{
  bufferAt(index);
  return memory_[index];
}

void OpenClCommand::enqueueAll(const std::string& kernel, const NdRange& range)
{
  const cl_kernel object = program_.kernel(kernel);
  for (size_t index = 0; index < size(); ++index)
  {
    const Argument& argument = at(index);
    if (argument.isBuffer())
    {
      setArgument(object, kernel, static_cast<cl_uint>(index), memory_[index]);
    }
    else
    {
      setRawArgument(object, kernel, static_cast<cl_uint>(index), argument.valueBytes(), argument.valueData());
    }
  }
  launch(object, kernel, range);
}

cl_event OpenClCommand::takeLastEvent()
{
  return std::exchange(last_, nullptr);
}

void OpenClCommand::setRawArgument(cl_kernel object, const std::string& kernel, cl_uint index, size_t bytes,
                                   const void* value)
{
  const cl_int code = clSetKernelArg(object, index, bytes, value);
  if (code != CL_SUCCESS)
  {
    throw OpenClError(
        "argument " + std::to_string(index) + " (" + std::to_string(bytes) + " bytes) of kernel " + kernel, code);
  }
}

void OpenClCommand::launch(cl_kernel object, const std::string& kernel, const NdRange& range)
{
  cl_event event = nullptr;
  const cl_int code = clEnqueueNDRangeKernel(queue_, object, range.dimensions, range.first, range.global, range.local,
                                             0, nullptr, &event);
  if (code != CL_SUCCESS)
  {
    throw OpenClError("kernel " + kernel + " with global size " + std::to_string(range.global[0]) + " x " +
                          std::to_string(range.global[1]) + ", local size " + std::to_string(range.local[0]) + " x " +
                          std::to_string(range.local[1]),
                      code);
  }
  if (last_ != nullptr)
  {
    clReleaseEvent(last_);
  }
  last_ = event;
}

OpenClImplementation singleKernel(std::string source, std::string kernel, size_t local, std::string options)
{
  OpenClImplementation implementation;
  implementation.source = std::move(source);
  implementation.options = std::move(options);
  implementation.kernels = {kernel};
  implementation.function = [kernel = std::move(kernel), local](OpenClCommand& command)
  { command.enqueueAll(kernel, NdRange(command.end() - command.begin(), local).offset(command.begin())); };
  return implementation;
}

}  // namespace pi_runtime
