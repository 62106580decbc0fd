#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <string>

/// Values as JSON.
namespace pi_simulation::json
{

/// What is not finite becomes null.
inline std::string number(double value, int digits = 4)
{
  if (!std::isfinite(value))
  {
    return "null";
  }
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

inline std::string text(const std::string& value)
{
  std::string result = "\"";
  for (const char c : value)
  {
    if (static_cast<unsigned char>(c) < 0x20)
    {
      result += ' ';
      continue;
    }
    if (c == '"' || c == '\\')
    {
      result += '\\';
    }
    result += c;
  }
  return result + "\"";
}

inline std::string list(std::initializer_list<double> values)
{
  std::string result = "[";
  for (const double value : values)
  {
    result += (result.size() > 1 ? ", " : "") + number(value);
  }
  return result + "]";
}

inline std::string point(const Eigen::Vector2d& value)
{
  return list({value.x(), value.y()});
}

}  // namespace pi_simulation::json
