#pragma once

#include <string>

namespace pi_detect
{

inline bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

}  // namespace pi_detect
