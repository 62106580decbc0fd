#include <pi_runtime/codelet.h>

#include <algorithm>
#include <cctype>

namespace pi_runtime
{

const char* toString(UnitType type)
{
  switch (type)
  {
    case UnitType::CPU:
      return "cpu";
    case UnitType::GPU:
      return "gpu";
    case UnitType::ACCELERATOR:
      return "accelerator";
  }
  return "unknown";
}

Argument::Argument(BufferPtr buffer, Access access) : buffer_(std::move(buffer)), access_(access)
{
  if (!buffer_)
  {
    throw std::invalid_argument("Argument: the buffer is null");
  }
  if (writes(access_) && buffer_->readOnly())
  {
    throw std::invalid_argument("Argument: the buffer is read-only and cannot be written; pass it with Argument::in()");
  }
}

Argument Argument::bytes(const void* data, size_t size)
{
  if (size == 0 || size > MAX_VALUE_BYTES)
  {
    throw std::invalid_argument("Argument::bytes: a value of " + std::to_string(size) + " bytes, must be 1 to " +
                                std::to_string(MAX_VALUE_BYTES) + "; pass larger ones as a buffer");
  }
  return Argument(data, size);
}

const Argument& TaskArguments::at(size_t index) const
{
  if (index >= arguments_.size())
  {
    throw std::out_of_range("argument " + std::to_string(index) + " was asked for, the task has " +
                            std::to_string(arguments_.size()));
  }
  return arguments_[index];
}

Buffer& TaskArguments::bufferAt(size_t index) const
{
  const Argument& argument = at(index);
  if (!argument.isBuffer())
  {
    throw std::invalid_argument("argument " + std::to_string(index) + " is a value, must be a buffer");
  }
  return *argument.buffer();
}

void TaskArguments::copyValue(size_t index, void* to, size_t bytes) const
{
  const Argument& argument = at(index);
  if (argument.isBuffer())
  {
    throw std::invalid_argument("argument " + std::to_string(index) + " is a buffer, must be a value");
  }
  if (argument.valueBytes() != bytes)
  {
    throw std::invalid_argument("argument " + std::to_string(index) + " has " + std::to_string(argument.valueBytes()) +
                                " bytes, must have " + std::to_string(bytes));
  }
  std::memcpy(to, argument.valueData(), bytes);
}

void Codelet::validate() const
{
  const bool word =
      !name.empty() && std::all_of(name.begin(), name.end(),
                                   [](unsigned char letter) { return std::isgraph(letter) != 0 && letter != ','; });
  if (!word)
  {
    throw std::invalid_argument("Codelet: the name \"" + name + "\" must be one word without commas");
  }
  const std::string where = "Codelet " + name + ": ";
  if (native.empty() && opencl.empty())
  {
    throw std::invalid_argument(where + "has no implementation; give a native or an OpenCL one");
  }
  if (native.size() > 1 || opencl.size() > 1)
  {
    throw std::invalid_argument(where + "has several implementations of one kind; make them codelets of their own");
  }
  if (!native.empty() && !native.front().function)
  {
    throw std::invalid_argument(where + "native.function is empty");
  }
  if (!native.empty() && (native.front().unit_types & ANY_UNIT_TYPE) == 0)
  {
    throw std::invalid_argument(where + "native.unit_types names no type of unit");
  }
  if (!opencl.empty() && (!opencl.front().function || opencl.front().source.empty()))
  {
    throw std::invalid_argument(where + "opencl.source or opencl.function is empty");
  }
  if (slice_granularity == 0)
  {
    throw std::invalid_argument(where + "slice_granularity = 0, must be at least 1");
  }
}

CodeletPtr makeCodelet(Codelet codelet)
{
  codelet.validate();
  return std::make_shared<const Codelet>(std::move(codelet));
}

}  // namespace pi_runtime
