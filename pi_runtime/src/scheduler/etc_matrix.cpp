#include <pi_runtime/etc_matrix.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace pi_runtime
{
namespace
{

std::string_view trimmed(std::string_view text)
{
  const size_t first = text.find_first_not_of(" \t\r");
  return first == std::string_view::npos ? std::string_view{}
                                         : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::vector<std::string_view> splitFields(std::string_view line)
{
  std::vector<std::string_view> fields;
  for (size_t begin = 0; begin <= line.size();)
  {
    const size_t end = std::min(line.find(',', begin), line.size());
    fields.push_back(trimmed(line.substr(begin, end - begin)));
    begin = end + 1;
  }
  return fields;
}

std::optional<double> parseNumber(std::string_view text)
{
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size())
  {
    return std::nullopt;
  }
  return value;
}

[[noreturn]] void refuseLine(size_t number, std::string_view line, const std::string& expected)
{
  throw std::runtime_error("line " + std::to_string(number) + " \"" + std::string(line) + "\": expected " + expected);
}

/// Appends the numbers of one line to `values`.
/// @return false, with `values` unchanged, if no field is a number, which is how a header looks.
bool appendRow(size_t number, std::string_view line, const std::vector<std::string_view>& fields,
               std::vector<double>* values)
{
  const size_t size_before = values->size();
  std::string_view garbage;
  bool has_garbage = false;
  for (std::string_view field : fields)
  {
    if (const std::optional<double> value = parseNumber(field))
    {
      values->push_back(*value);
    }
    else if (!has_garbage)
    {
      garbage = field;
      has_garbage = true;
    }
  }
  if (values->size() == size_before)
  {
    return false;
  }
  if (has_garbage)
  {
    refuseLine(number, line, "numbers or inf separated by commas, not \"" + std::string(garbage) + "\"");
  }
  return true;
}

}  // namespace

EtcMatrix::EtcMatrix(size_t tasks, size_t units)
  : tasks_(tasks), units_(units), values_(tasks * units, std::numeric_limits<double>::infinity())
{
}

EtcMatrix::EtcMatrix(size_t tasks, size_t units, std::vector<double> values)
  : tasks_(tasks), units_(units), values_(std::move(values))
{
  if (values_.size() != tasks * units)
  {
    throw std::invalid_argument("ETC matrix: " + std::to_string(values_.size()) + " values for " +
                                std::to_string(tasks) + " tasks x " + std::to_string(units) + " units, expected " +
                                std::to_string(tasks * units));
  }
}

void EtcMatrix::resize(size_t tasks, size_t units)
{
  tasks_ = tasks;
  units_ = units;
  values_.resize(tasks * units);
}

void EtcMatrix::validate() const
{
  for (size_t i = 0; i < values_.size(); ++i)
  {
    if (!(values_[i] > 0.0))
    {
      std::ostringstream text;
      text << "ETC matrix: task " << i / units_ << " on unit " << i % units_ << " = " << values_[i]
           << ", must be > 0 (inf: the task cannot run there)";
      throw std::invalid_argument(text.str());
    }
  }
}

EtcMatrix readEtcCsv(std::istream& input)
{
  std::vector<double> values;
  size_t rows = 0;
  size_t columns = 0;
  bool header_allowed = true;
  std::string text;
  for (size_t number = 1; std::getline(input, text); ++number)
  {
    const std::string_view line = trimmed(text);
    if (line.empty() || line.front() == '#')
    {
      continue;
    }
    const std::vector<std::string_view> fields = splitFields(line);
    if (columns != 0 && fields.size() != columns)
    {
      refuseLine(number, line, std::to_string(columns) + " fields as before, found " + std::to_string(fields.size()));
    }
    columns = fields.size();
    if (appendRow(number, line, fields, &values))
    {
      ++rows;
    }
    else if (!header_allowed)
    {
      refuseLine(number, line, "numbers or inf separated by commas");
    }
    header_allowed = false;
  }
  if (input.bad())
  {
    throw std::runtime_error("the input cannot be read: " + std::string(std::strerror(errno)));
  }
  return EtcMatrix(rows, columns, std::move(values));
}

EtcMatrix readEtcCsv(const std::string& path)
{
  std::ifstream file(path);
  if (!file)
  {
    throw std::runtime_error(path + ": " + std::strerror(errno));
  }
  try
  {
    return readEtcCsv(file);
  }
  catch (const std::runtime_error& error)
  {
    throw std::runtime_error(path + ": " + error.what());
  }
}

}  // namespace pi_runtime
