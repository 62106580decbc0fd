#pragma once

#include <pi_node/durations.h>

#include <cstdint>
#include <cstdio>
#include <string>

namespace pi_node
{

/// A number in a pattern of printf; at most 63 characters.
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

}  // namespace pi_node
