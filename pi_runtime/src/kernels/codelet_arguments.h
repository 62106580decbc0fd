#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

#include <pi_runtime/codelet.h>

namespace pi_runtime
{
namespace kernels
{

/// @throws std::invalid_argument naming codelet and argument if the buffer at index has less than `needed` bytes.
inline void requireBytes(const TaskArguments& arguments, const char* codelet, size_t index, const char* name,
                         size_t needed)
{
  const size_t bytes = arguments.bufferBytes(index);
  if (bytes < needed)
  {
    throw std::invalid_argument(std::string(codelet) + ": argument " + std::to_string(index) + " (" + name + ") has " +
                                std::to_string(bytes) + " bytes, must have at least " + std::to_string(needed));
  }
}

/// @throws std::invalid_argument if the task's range is not the one that its arguments imply.
inline void requireRange(const TaskArguments& arguments, const char* codelet, const char* meaning, size_t needed)
{
  if (arguments.range() != needed)
  {
    throw std::invalid_argument(std::string(codelet) + ": the range is " + std::to_string(arguments.range()) +
                                ", must be " + std::to_string(needed) + " (" + meaning + ")");
  }
}

/// @throws std::invalid_argument if value is outside [low, high].
inline void requireBetween(const char* codelet, const char* name, long long value, long long low, long long high)
{
  if (value < low || value > high)
  {
    throw std::invalid_argument(std::string(codelet) + ": " + name + " = " + std::to_string(value) + ", must be " +
                                std::to_string(low) + " to " + std::to_string(high));
  }
}

/// Smallest multiple of `step` that is not below value.
inline size_t roundUp(size_t value, size_t step)
{
  return (value + step - 1) / step * step;
}

}  // namespace kernels
}  // namespace pi_runtime
