#pragma once

#include <cstddef>

namespace pi_runtime
{
namespace kernels
{

/// Bytes from the first to the last pixel of an image of at least one row.
inline size_t imageBytes(int height, int stride, int row_bytes)
{
  return (static_cast<size_t>(height) - 1) * static_cast<size_t>(stride) + static_cast<size_t>(row_bytes);
}

}  // namespace kernels
}  // namespace pi_runtime
