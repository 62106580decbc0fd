#pragma once

namespace pi_runtime::kernels
{

/// Index of the pixel that stands for pixel i outside of [0, size): mirrored at the outermost pixel, which is not
/// repeated (gfedcb|abcdefgh|gfedcba, OpenCV's BORDER_REFLECT_101).
inline int reflect101(int i, int size)
{
  if (size == 1)
  {
    return 0;
  }
  while (i < 0 || i >= size)
  {
    i = i < 0 ? -i : 2 * (size - 1) - i;
  }
  return i;
}

}  // namespace pi_runtime::kernels
