#pragma once

#include <cstddef>
#include <cstdint>

namespace pi_detect
{

/// A picture owned by the caller.
struct PictureView
{
  enum class Format
  {
    BGR8,
    RGB8,
    MONO8,
  };
  const uint8_t* data = nullptr;
  int width = 0;      ///< [px]
  int height = 0;     ///< [px]
  size_t stride = 0;  ///< from row to row [bytes]
  Format format = Format::BGR8;
};

}  // namespace pi_detect
