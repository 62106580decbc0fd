#pragma once

#include <cstdint>
#include <string>

namespace pi_os_transport
{

/// Where a ROS process listens and what others are told to connect to.
struct NetworkAddress
{
  std::string bind;  ///< numeric address
  std::string host;  ///< name or address for URIs
};

/// As rosgraph decides it: __hostname, __ip, ROS_HOSTNAME or ROS_IP, else the name of the computer, else an address of
/// it that is not the loopback's; a loopback host is listened to on the loopback only. ROS_IPV6=on takes IPv6 too.
/// @param remapped  what "__hostname:=" or "__ip:=" on the command line says, or "".
/// @throws std::invalid_argument if one of the variables is no host: names it, its value and what is expected.
NetworkAddress networkAddress(const std::string& remapped = "");

/// "http://host:port/"
std::string httpUri(const std::string& host, uint16_t port);

struct HostAndPort
{
  std::string host;  ///< without the brackets of IPv6
  uint16_t port = 0;
};
/// @param uri  "http://host:port/...". @throws std::invalid_argument naming the URI
HostAndPort parseHttpUri(const std::string& uri);

}  // namespace pi_os_transport
