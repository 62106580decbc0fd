#pragma once

#include <cstddef>
#include <cstdint>

namespace pi_runtime
{

/// Pixels of one channel, or interleaved channels, in memory that belongs to somebody else. Row-major.
template <typename T>
struct ImageView
{
  T* data;
  int width;         ///< [px]
  int height;        ///< [px]
  size_t stride;     ///< from row to row [elements of T], at least width * channels
  int channels = 1;  ///< interleaved

  T* row(int y) const { return data + static_cast<size_t>(y) * stride; }
};

}  // namespace pi_runtime
