#include "roscpp/options.h"

#include <fnmatch.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>

#include "text_parsing.h"

namespace pi_os_transport
{
namespace
{

constexpr uint64_t MAX_POOL_MB = 65536;
constexpr uint64_t MAX_MIN_BYTES = 1000000000;  // roscpp's limit of a message
constexpr size_t MAX_BRIDGE_NAME = 64;

bool matchesAny(const std::vector<std::string>& patterns, const std::string& topic)
{
  return std::any_of(patterns.begin(), patterns.end(),
                     [&topic](const std::string& pattern) { return fnmatch(pattern.c_str(), topic.c_str(), 0) == 0; });
}

std::optional<bool> parseSwitch(std::string text)
{
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  const bool on = text == "1" || text == "true";
  return on || text == "0" || text == "false" ? std::optional<bool>(on) : std::nullopt;
}

std::vector<std::string> splitPatterns(const std::string& text)
{
  std::vector<std::string> patterns(1);
  for (char c : text)
  {
    if (c == ',')
    {
      patterns.emplace_back();
    }
    else if (std::isspace(static_cast<unsigned char>(c)) == 0)
    {
      patterns.back() += c;
    }
  }
  patterns.erase(std::remove(patterns.begin(), patterns.end(), ""), patterns.end());
  return patterns;
}

}  // namespace

bool Options::carries(const std::string& topic) const
{
  return enable && matchesAny(include, topic) && !matchesAny(exclude, topic);
}

void Options::load(const Source& source, const std::function<std::string(const std::string&)>& describe,
                   std::vector<std::string>* errors)
{
  const auto refuse =
      [&](const char* name, const std::string& value, const std::string& allowed, const std::string& kept)
  {
    errors->push_back(describe(name) + " = \"" + value + "\" is ignored: it must be " + allowed + "; " + kept +
                      " stays in force");
  };
  const auto number = [&](const char* name, uint64_t lowest, uint64_t highest, uint64_t* field)
  {
    const std::optional<std::string> text = source(name);
    if (!text)
    {
      return;
    }
    const std::optional<uint64_t> value = parseNumber(*text, lowest, highest);
    if (!value)
    {
      refuse(name, *text, "a whole number from " + std::to_string(lowest) + " to " + std::to_string(highest),
             std::to_string(*field));
      return;
    }
    *field = *value;
  };
  const auto flag = [&](const char* name, bool* field)
  {
    const std::optional<std::string> text = source(name);
    const std::optional<bool> value = text ? parseSwitch(*text) : *field;
    if (!value)
    {
      refuse(name, *text, "1, 0, true or false", *field ? "1" : "0");
    }
    *field = value.value_or(*field);
  };

  flag("enable", &enable);
  if (const std::optional<std::string> text = source("include"))
  {
    include = splitPatterns(*text);
  }
  if (const std::optional<std::string> text = source("exclude"))
  {
    exclude = splitPatterns(*text);
  }
  number("pool_limit_mb", 1, MAX_POOL_MB, &pool_limit_mb);
  number("min_bytes", 0, MAX_MIN_BYTES, &min_bytes);
  flag("skip_zero_fill", &skip_zero_fill);
  if (const std::optional<std::string> text = source("bridge"))
  {
    if (text->size() > MAX_BRIDGE_NAME || text->find('/') != std::string::npos)
    {
      refuse("bridge", *text, "0, or a name of at most " + std::to_string(MAX_BRIDGE_NAME) + " characters without /",
             bridge.empty() ? "0" : bridge);
    }
    else
    {
      bridge = *text == "0" ? "" : *text;
    }
  }
  if (const std::optional<std::string> text = source("require_bridge"))
  {
    const std::optional<bool> value = parseSwitch(*text);
    if (!value)
    {
      refuse("require_bridge", *text, "1, 0, true or false", "1");  // a slip must not send anything unprotected
    }
    require_bridge = value.value_or(true);
  }
}

void Options::loadEnvironment(std::vector<std::string>* errors)
{
  const auto variable = [](const std::string& name)
  {
    std::string result = "PI_OS_" + name;
    std::transform(result.begin(), result.end(), result.begin(), [](unsigned char c) { return std::toupper(c); });
    return result;
  };
  load(
      [&variable](const std::string& name) -> std::optional<std::string>
      {
        const char* value = std::getenv(variable(name).c_str());
        return value != nullptr ? std::optional<std::string>(value) : std::nullopt;
      },
      variable, errors);
}

}  // namespace pi_os_transport
