#pragma once

#include <sys/socket.h>

#include <cstdint>
#include <string>

namespace pi_os_transport
{

/// A socket address of any family.
struct SocketAddress
{
  sockaddr_storage storage{};
  socklen_t size = 0;  ///< 0: none

  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }
  sockaddr* get() { return reinterpret_cast<sockaddr*>(&storage); }
  uint16_t port() const;
  SocketAddress withPort(uint16_t port) const;
};
/// Finds the address of a host, IPv4 first. Waits for a name server unless `flags` have AI_NUMERICHOST.
/// @param flags  of getaddrinfo(). @return without size: the host is not known
SocketAddress findAddress(const std::string& host, int flags);

/// The address of a ROS process.
struct NetworkAddress
{
  std::string bind;  ///< numeric address to listen on
  std::string host;  ///< name or address in URIs
};

/// By the rules of rosgraph: __hostname, __ip, ROS_HOSTNAME or ROS_IP, else the name of the computer, else one of its
/// addresses that is not a loopback address. For a given loopback host, listens on the loopback only. ROS_IPV6=on
/// allows IPv6.
/// @param remapped  value of "__hostname:=" or "__ip:=" on the command line, or "".
/// @throws std::invalid_argument naming the variable, its value and what is expected
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
