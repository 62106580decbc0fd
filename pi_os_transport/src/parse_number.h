#pragma once

#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>

namespace pi_os_transport
{

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
