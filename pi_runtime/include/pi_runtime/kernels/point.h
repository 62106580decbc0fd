#pragma once

namespace pi_runtime::kernels
{

/// A position in an image [px]; (0, 0) is the middle of the first pixel.
struct Point2f
{
  float x;
  float y;
};

}  // namespace pi_runtime::kernels
