#pragma once

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace pi_node
{

/// Checks the fields of an options struct: errors name field, value and bound, as "tracker/levels = 0, must be in [1,
/// 8]".
class OptionCheck
{
public:
  explicit OptionCheck(std::string group) : group_(std::move(group)) {}

  /// @param source  of the bound, for the message; empty: it is fixed.
  /// @throws std::invalid_argument if value is outside of [least, most] or not finite.
  template <typename T>
  void range(const char* field, T value, T least, T most, const std::string& source = "") const
  {
    if (!(value >= least && value <= most))
    {
      std::ostringstream text;
      text << group_ << (group_.empty() ? "" : "/") << field << " = " << value << ", must be in [" << least << ", "
           << most << "]" << (source.empty() ? "" : " (" + source + ")");
      throw std::invalid_argument(text.str());
    }
  }

  /// @throws std::invalid_argument if value is not above zero, or not finite.
  void positive(const char* field, double value) const
  {
    if (!(value > 0.0 && std::isfinite(value)))
    {
      std::ostringstream text;
      text << group_ << (group_.empty() ? "" : "/") << field << " = " << value << ", must be positive";
      throw std::invalid_argument(text.str());
    }
  }

private:
  std::string group_;
};

}  // namespace pi_node
