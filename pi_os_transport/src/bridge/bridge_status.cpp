#include "bridge/bridge_status.h"

#include "json.h"

namespace pi_os_transport
{
namespace
{

constexpr int STATUS_VERSION = 1;

std::string toText(const BridgeStatus::Value& value)
{
  return std::holds_alternative<uint64_t>(value) ? std::to_string(std::get<uint64_t>(value))
                                                 : jsonString(std::get<std::string>(value));
}

std::string toText(const BridgeStatus::Object& object)
{
  std::string out = "{";
  for (const auto& member : object)
  {
    out += (out.size() > 1 ? "," : "") + jsonString(member.first) + ":" + toText(member.second);
  }
  return out + "}";
}

std::string toText(const std::string& text)
{
  return jsonString(text);
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
  return "{\"version\":" + std::to_string(STATUS_VERSION) + ",\"name\":" + jsonString(name) +
         ",\"instance\":" + jsonString(std::to_string(instance)) + ",\"wire\":" + jsonString(wire) +
         ",\"listen\":" + toText(listen) + ",\"pool\":" + toText(pool) + ",\"refused\":" + toText(refused) +
         ",\"peers\":" + toText(peers) + ",\"outgoing\":" + toText(outgoing) + ",\"incoming\":" + toText(incoming) +
         ",\"tunnels\":" + toText(tunnels) + "}";
}

}  // namespace pi_os_transport
