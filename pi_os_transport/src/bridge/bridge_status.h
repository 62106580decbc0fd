#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace pi_os_transport
{

/// What a bridge tells about itself.
struct BridgeStatus
{
  using Value = std::variant<uint64_t, std::string>;
  using Object = std::vector<std::pair<const char*, Value>>;

  std::string name;
  uint64_t instance = 0;
  std::string wire;
  std::vector<std::string> listen;
  Object pool;
  Object refused;
  std::vector<Object> peers;
  std::vector<Object> outgoing;
  std::vector<Object> incoming;
  std::vector<Object> tunnels;

  std::string toJson() const;
};

}  // namespace pi_os_transport
