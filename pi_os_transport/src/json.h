#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace pi_os_transport
{

/// `text` as a JSON string with its quotes; bytes beyond ASCII are escaped one by one.
std::string jsonString(const std::string& text);

/// `elements`, each JSON already, as a JSON array.
std::string jsonArray(const std::vector<std::string>& elements);

/// Builds one JSON object, member by member.
class JsonObject
{
public:
  JsonObject& text(const char* name, const std::string& value) { return raw(name, jsonString(value)); }
  JsonObject& number(const char* name, uint64_t value) { return raw(name, std::to_string(value)); }
  JsonObject& flag(const char* name, bool value) { return raw(name, value ? "true" : "false"); }
  /// @param value  JSON already.
  JsonObject& raw(const char* name, const std::string& value);
  std::string toString() const { return "{" + members_ + "}"; }

private:
  std::string members_;
};

}  // namespace pi_os_transport
