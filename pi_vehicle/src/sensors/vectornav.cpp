#include "sensors/vectornav.h"

#include <charconv>
#include <cmath>
#include <cstdio>

namespace pi_vehicle
{
namespace
{

using Kind = VectorNavLine::Kind;

constexpr size_t LONGEST_LINE = 256;  ///< of the protocol: some 200 bytes
constexpr size_t LINE_END_BYTES = 2;
constexpr size_t FIELDS = 11;
constexpr size_t ACCELERATION_FIELD = 3;
constexpr size_t ANGULAR_VELOCITY_FIELD = 6;
constexpr std::string_view MEASUREMENT_HEADER = "VNIMU,";

unsigned checksum(std::string_view text)
{
  unsigned sum = 0;
  for (const char character : text)
  {
    sum ^= static_cast<unsigned char>(character);
  }
  return sum;
}

/// std::from_chars knows no leading plus. @return whether all of the text is a number.
bool toNumber(std::string_view text, double* number)
{
  if (!text.empty() && text.front() == '+')
  {
    text.remove_prefix(1);
  }
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *number);
  return error == std::errc() && end == text.data() + text.size();
}

Kind readFields(std::string_view text, ImuMeasurement* measurement)
{
  std::array<double, FIELDS> values = {};
  for (size_t i = 0; i < FIELDS; ++i)
  {
    const size_t comma = text.find(',');
    if (!toNumber(text.substr(0, comma), &values[i]) || (comma == std::string_view::npos) != (i + 1 == FIELDS))
    {
      return Kind::TORN;
    }
    text.remove_prefix(comma == std::string_view::npos ? text.size() : comma + 1);
  }
  bool finite = true;
  for (size_t axis = 0; axis < 3; ++axis)
  {
    measurement->acceleration[axis] = values[ACCELERATION_FIELD + axis];
    measurement->angular_velocity[axis] = values[ANGULAR_VELOCITY_FIELD + axis];
    finite = finite && std::isfinite(values[ACCELERATION_FIELD + axis] + values[ANGULAR_VELOCITY_FIELD + axis]);
  }
  return finite ? Kind::MEASUREMENT : Kind::NOT_FINITE;
}

}  // namespace

VectorNavLine parseVectorNav(std::string_view line)
{
  VectorNavLine result;
  result.bytes = line.size() + LINE_END_BYTES;
  const size_t star = line.rfind('*');
  const std::string_view digits = star == std::string_view::npos ? "" : line.substr(star + 1);
  unsigned told = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), told, 16);
  const std::string_view text = line.substr(1, star == std::string_view::npos ? star : star - 1);
  result.text = text;
  if (digits.size() != 2 || error != std::errc() || end != digits.data() + 2 || told != checksum(text))
  {
    result.kind = Kind::WRONG_CHECKSUM;
  }
  else if (text.substr(0, MEASUREMENT_HEADER.size()) == MEASUREMENT_HEADER)
  {
    result.kind = readFields(text.substr(MEASUREMENT_HEADER.size()), &result.measurement);
  }
  else
  {
    result.kind = Kind::OTHER;
  }
  return result;
}

std::string vectorNavCommand(const std::string& text)
{
  char end[8];
  std::snprintf(end, sizeof end, "*%02X\r\n", checksum(text));
  return "$" + text + end;
}

void VectorNavReader::onBytes(const uint8_t* bytes, size_t size,
                              const std::function<void(const VectorNavLine&)>& on_line)
{
  for (size_t i = 0; i < size; ++i)
  {
    const auto character = static_cast<char>(bytes[i]);
    if (character == '$')
    {
      tear(on_line);
      line_ = "$";
    }
    else if (character == '\n' && !line_.empty())
    {
      if (line_.back() == '\r')
      {
        line_.pop_back();
      }
      const VectorNavLine line = parseVectorNav(line_);
      line_.clear();
      on_line(line);
    }
    else if (!line_.empty())
    {
      line_ += character;
      if (line_.size() > LONGEST_LINE)
      {
        tear(on_line);
      }
    }
    else if (character != '\r' && character != '\n')
    {
      ++garbage_bytes_;
    }
  }
}

void VectorNavReader::tear(const std::function<void(const VectorNavLine&)>& on_line)
{
  if (!line_.empty())
  {
    garbage_bytes_ += line_.size();
    VectorNavLine torn;
    torn.bytes = line_.size();
    line_.clear();
    on_line(torn);
  }
}

}  // namespace pi_vehicle
