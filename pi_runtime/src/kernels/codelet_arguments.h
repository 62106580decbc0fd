#pragma once

#include <pi_runtime/codelet.h>
#include <pi_runtime/opencl_command.h>

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "kernel_sources.h"

namespace pi_runtime::kernels
{

constexpr uint64_t NOT_SLICEABLE = 0;  ///< as a granularity of slices

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

/// @param source  of the kernels, which may use prelude.cl.
inline CodeletPtr makeKernelCodelet(const char* name, NativeFunction native, const char* source,
                                    std::vector<std::string> kernels, OpenClFunction opencl,
                                    uint64_t slice_granularity = 1, const std::string& options = "")
{
  Codelet codelet;
  codelet.name = name;
  codelet.native = {NativeImplementation{std::move(native)}};
  codelet.opencl = {
      OpenClImplementation{std::string(prelude_cl) + source, options, std::move(kernels), std::move(opencl)}};
  codelet.sliceable = slice_granularity != NOT_SLICEABLE;
  codelet.slice_granularity = std::max<uint64_t>(slice_granularity, 1);
  return makeCodelet(std::move(codelet));
}

/// Bytes from the first to the last pixel of an image of at least one row.
inline size_t imageBytes(int height, int stride, int row_bytes)
{
  return (static_cast<size_t>(height) - 1) * static_cast<size_t>(stride) + static_cast<size_t>(row_bytes);
}

/// Smallest multiple of `step` that is not below value.
inline size_t roundUp(size_t value, size_t step)
{
  return (value + step - 1) / step * step;
}

}  // namespace pi_runtime::kernels
