#include "json.h"

#include <cstdio>

namespace pi_os_transport
{

std::string jsonString(const std::string& text)
{
  std::string out = "\"";
  for (const char c : text)
  {
    if (c == '"' || c == '\\')
    {
      out += '\\';
      out += c;
    }
    else if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) >= 0x7f)
    {
      char escaped[8];
      std::snprintf(escaped, sizeof(escaped), "\\u%04x", static_cast<unsigned char>(c));
      out += escaped;
    }
    else
    {
      out += c;
    }
  }
  return out + "\"";
}

std::string jsonArray(const std::vector<std::string>& elements)
{
  std::string out = "[";
  for (const std::string& element : elements)
  {
    out += (out.size() > 1 ? "," : "") + element;
  }
  return out + "]";
}

JsonObject& JsonObject::raw(const char* name, const std::string& value)
{
  members_ += (members_.empty() ? "" : ",") + jsonString(name) + ":" + value;
  return *this;
}

}  // namespace pi_os_transport
