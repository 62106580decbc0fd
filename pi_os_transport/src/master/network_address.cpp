#include "master/network_address.h"

#include <ifaddrs.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string_view>

#include "text_parsing.h"

namespace pi_os_transport
{
namespace
{

constexpr uint16_t HTTP_PORT = 80;

// Both families have the port at the same place.
static_assert(offsetof(sockaddr_in, sin_port) == offsetof(sockaddr_in6, sin6_port));

bool isLoopback(const std::string& host)
{
  return host == "localhost" || host.rfind("127.", 0) == 0 || host == "::1";
}

/// A numeric address of this computer; a loopback address if there is no other.
std::string ownAddress(bool ipv6)
{
  std::string found = ipv6 ? "::1" : "127.0.0.1";
  ifaddrs* interfaces = nullptr;
  if (getifaddrs(&interfaces) != 0)
  {
    return found;
  }
  for (const ifaddrs* one = interfaces; one != nullptr; one = one->ifa_next)
  {
    if (one->ifa_addr == nullptr || one->ifa_addr->sa_family != (ipv6 ? AF_INET6 : AF_INET))
    {
      continue;
    }
    std::array<char, NI_MAXHOST> text;
    const socklen_t size = ipv6 ? sizeof(sockaddr_in6) : sizeof(sockaddr_in);
    if (getnameinfo(one->ifa_addr, size, text.data(), text.size(), nullptr, 0, NI_NUMERICHOST) == 0 &&
        !isLoopback(text.data()))
    {
      found = text.data();
      break;
    }
  }
  freeifaddrs(interfaces);
  return found;
}

void checkHost(const std::string& variable, const std::string& host)
{
  const size_t colons = static_cast<size_t>(std::count(host.begin(), host.end(), ':'));
  if (host.empty() || host.find('/') != std::string::npos || colons == 1)
  {
    throw std::invalid_argument(variable + " = \"" + host +
                                "\", must be a host name or address without protocol and port");
  }
}

}  // namespace

uint16_t SocketAddress::port() const
{
  return ntohs(reinterpret_cast<const sockaddr_in*>(&storage)->sin_port);
}

SocketAddress SocketAddress::withPort(uint16_t port) const
{
  SocketAddress changed = *this;
  reinterpret_cast<sockaddr_in*>(&changed.storage)->sin_port = htons(port);
  return changed;
}

SocketAddress findAddress(const std::string& host, int flags)
{
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = flags;
  addrinfo* found = nullptr;
  SocketAddress address;
  if (getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0)
  {
    return address;
  }
  // IPv4 first: nodes use it by default.
  const addrinfo* chosen = found;
  for (const addrinfo* one = found; one != nullptr && chosen->ai_family != AF_INET; one = one->ai_next)
  {
    chosen = one->ai_family == AF_INET ? one : chosen;
  }
  std::memcpy(&address.storage, chosen->ai_addr, chosen->ai_addrlen);
  address.size = chosen->ai_addrlen;
  freeaddrinfo(found);
  return address;
}

NetworkAddress networkAddress(const std::string& remapped)
{
  const char* const ipv6_variable = std::getenv("ROS_IPV6");
  const bool ipv6 = ipv6_variable != nullptr && std::string_view(ipv6_variable) == "on";
  std::string host = remapped;
  if (!host.empty())
  {
    checkHost("__hostname or __ip", host);
  }
  for (const char* variable : {"ROS_HOSTNAME", "ROS_IP"})
  {
    const char* const value = std::getenv(variable);
    if (host.empty() && value != nullptr)
    {
      host = value;
      checkHost(variable, host);
    }
  }
  const bool is_given = !host.empty();
  if (!is_given)
  {
    std::array<char, 256> name{};
    if (gethostname(name.data(), name.size() - 1) == 0)
    {
      host = name.data();
    }
    if (host.empty() || isLoopback(host))
    {
      host = ownAddress(ipv6);
    }
  }
  NetworkAddress address;
  address.host = host;
  if (is_given && isLoopback(host))
  {
    address.bind = ipv6 ? "::1" : host.rfind("127.", 0) == 0 ? host : "127.0.0.1";
  }
  else
  {
    address.bind = ipv6 ? "::" : "0.0.0.0";
  }
  return address;
}

std::string httpUri(const std::string& host, uint16_t port)
{
  const bool is_ipv6 = host.find(':') != std::string::npos;
  return "http://" + (is_ipv6 ? "[" + host + "]" : host) + ":" + std::to_string(port) + "/";
}

HostAndPort parseHttpUri(const std::string& uri)
{
  const std::string scheme = "http://";
  HostAndPort result;
  if (uri.rfind(scheme, 0) == 0)
  {
    const std::string_view authority =
        std::string_view(uri).substr(scheme.size(), uri.find_first_of("/?#", scheme.size()) - scheme.size());
    const size_t bracket = authority.rfind(']');
    const size_t colon = authority.rfind(':');
    const bool has_port = colon != std::string_view::npos && (bracket == std::string_view::npos || colon > bracket);
    std::string_view host = authority.substr(0, has_port ? colon : authority.size());
    if (bracket != std::string_view::npos && host.size() > 2)
    {
      host = host.substr(1, host.size() - 2);
    }
    const std::string_view port = has_port ? authority.substr(colon + 1) : std::string_view();
    result.host = host;
    result.port = has_port ? parseNumber<uint16_t>(port, 1, 65535).value_or(0) : HTTP_PORT;
    if (!result.host.empty() && result.port != 0)
    {
      return result;
    }
  }
  throw std::invalid_argument("\"" + uri + "\" is no URI like http://host:11311/");
}

}  // namespace pi_os_transport
