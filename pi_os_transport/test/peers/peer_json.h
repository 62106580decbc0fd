#pragma once

#include <cstdio>
#include <string>

/// `text` as a JSON string.
inline std::string quoted(const std::string& text)
{
  std::string out = "\"";
  for (const char c : text)
  {
    if (c == '"' || c == '\\')
    {
      out += '\\';
      out += c;
    }
    else if (static_cast<unsigned char>(c) < 0x20)
    {
      char buffer[8];
      std::snprintf(buffer, sizeof(buffer), "\\u%04x", c);
      out += buffer;
    }
    else
    {
      out += c;
    }
  }
  return out + "\"";
}

class JsonObject
{
public:
  JsonObject& raw(const std::string& key, const std::string& json)
  {
    body_ += (body_.empty() ? "" : ",") + quoted(key) + ":" + json;
    return *this;
  }
  JsonObject& text(const std::string& key, const std::string& value) { return raw(key, quoted(value)); }
  JsonObject& boolean(const std::string& key, bool value) { return raw(key, value ? "true" : "false"); }
  template <class T>
  JsonObject& number(const std::string& key, T value)
  {
    return raw(key, std::to_string(value));
  }
  std::string str() const { return "{" + body_ + "}"; }

private:
  std::string body_;
};

template <class Container, class Function>
std::string jsonArray(const Container& items, Function&& render)
{
  std::string body;
  for (const auto& item : items)
  {
    body += (body.empty() ? "" : ",") + render(item);
  }
  return "[" + body + "]";
}
