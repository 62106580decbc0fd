#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace pi_node
{

/// A number in the pattern of printf.
inline std::string format(const char* pattern, double value)
{
  char text[64];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

/// "752x480"
inline std::string sizeText(int64_t width, int64_t height)
{
  return std::to_string(width) + "x" + std::to_string(height);
}

inline double seconds(int64_t ns)
{
  return 1e-9 * static_cast<double>(ns);
}

}  // namespace pi_node
