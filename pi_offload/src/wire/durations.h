#pragma once

#include <cstdint>

namespace pi_offload
{

inline double seconds(int64_t ns)
{
  return 1e-9 * static_cast<double>(ns);
}

inline double secondsBetween(int64_t from_ns, int64_t to_ns)
{
  return seconds(to_ns - from_ns);
}

/// @param seconds  within what int64_t holds in nanoseconds: 292 years.
inline int64_t nanoseconds(double seconds)
{
  return static_cast<int64_t>(seconds * 1e9);
}

}  // namespace pi_offload
