#pragma once

#include <pi_node/durations.h>

#include <cstdint>
#include <cstdio>
#include <string>

namespace pi_node
{

/// Numbers in a pattern of printf; each becomes a double.
template <typename... Numbers>
std::string format(const char* pattern, Numbers... numbers)
{
  std::string text(static_cast<size_t>(std::snprintf(nullptr, 0, pattern, static_cast<double>(numbers)...)), '\0');
  std::snprintf(text.data(), text.size() + 1, pattern, static_cast<double>(numbers)...);
  return text;
}

/// "752x480"
inline std::string sizeText(int64_t width, int64_t height)
{
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace pi_node
