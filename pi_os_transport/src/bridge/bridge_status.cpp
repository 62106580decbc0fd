#include "bridge_status.h"

#include <cstdio>

namespace pi_os_transport
{
namespace
{

constexpr int STATUS_VERSION = 1;

std::string quoted(const std::string& text)
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

std::string toText(const BridgeStatus::Value& value)
{
  return std::holds_alternative<uint64_t>(value) ? std::to_string(std::get<uint64_t>(value))
                                                 : quoted(std::get<std::string>(value));
}

std::string toText(const BridgeStatus::Object& object)
{
  std::string out = "{";
  for (const auto& member : object)
  {
    out += (out.size() > 1 ? "," : "") + quoted(member.first) + ":" + toText(member.second);
  }
  return out + "}";
}

std::string toText(const std::string& text)
{
  return quoted(text);
}

template <typename Item>
std::string toText(const std::vector<Item>& items)
{
  std::string out = "[";
  for (const Item& item : items)
  {
    out += (out.size() > 1 ? "," : "") + toText(item);
  }
  return out + "]";
}

}  // namespace

std::string BridgeStatus::toJson() const
{
  return "{\"version\":" + std::to_string(STATUS_VERSION) + ",\"name\":" + quoted(name) +
         ",\"instance\":" + quoted(std::to_string(instance)) + ",\"wire\":" + quoted(wire) +
         ",\"listen\":" + toText(listen) + ",\"pool\":" + toText(pool) + ",\"refused\":" + toText(refused) +
         ",\"peers\":" + toText(peers) + ",\"outgoing\":" + toText(outgoing) + ",\"incoming\":" + toText(incoming) +
         ",\"tunnels\":" + toText(tunnels) + "}";
}

}  // namespace pi_os_transport
