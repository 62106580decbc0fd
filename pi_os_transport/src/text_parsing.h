#pragma once

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>

namespace pi_os_transport
{

/// `text` without `spaces` at both ends.
inline std::string_view trimmed(std::string_view text, std::string_view spaces = " \t\r\n")
{
  text.remove_prefix(std::min(text.find_first_not_of(spaces), text.size()));
  return text.substr(0, text.find_last_not_of(spaces) + 1);
}

/// Reads a number that is all of `text` and lies in [least, most]. @return empty for any other text
template <typename Number>
std::optional<Number> parseNumber(std::string_view text, Number least, Number most)
{
  Number value{};
  const char* const end = text.data() + text.size();
  const std::from_chars_result result = std::from_chars(text.data(), end, value);
  const bool valid = result.ec == std::errc() && result.ptr == end && value >= least && value <= most;
  return valid ? std::optional<Number>(value) : std::nullopt;
}

}  // namespace pi_os_transport
