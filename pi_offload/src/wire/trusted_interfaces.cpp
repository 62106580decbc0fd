#include "wire/trusted_interfaces.h"

#include <ifaddrs.h>
#include <net/if.h>
#include <pi_node/unique_fd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace pi_offload
{
namespace
{

const char* const LOOPBACK = "lo";

/// An address without port and scope: IPv4 as IPv6 shows it.
std::array<uint8_t, 16> bytesOf(const sockaddr* address)
{
  std::array<uint8_t, 16> bytes{};
  if (address->sa_family == AF_INET6)
  {
    std::memcpy(bytes.data(), &reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr, 16);
  }
  else
  {
    bytes[10] = bytes[11] = 0xff;
    std::memcpy(&bytes[12], &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, 4);
  }
  return bytes;
}

std::array<uint8_t, 16> bytesOf(const SocketAddress& address)
{
  return bytesOf(reinterpret_cast<const sockaddr*>(&address.storage));
}

bool isV4(const std::array<uint8_t, 16>& bytes)
{
  static constexpr std::array<uint8_t, 12> PREFIX = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  return std::equal(PREFIX.begin(), PREFIX.end(), bytes.begin());
}

bool isLoopback(const std::array<uint8_t, 16>& bytes)
{
  return isV4(bytes) ? bytes[12] == 127 : std::equal(&bytes[0], &bytes[15], in6addr_loopback.s6_addr) && bytes[15] == 1;
}

/// Interfaces of this machine with this address.
std::vector<std::string> interfacesOf(const std::array<uint8_t, 16>& address)
{
  std::vector<std::string> found;
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0)
  {
    return found;
  }
  for (const ifaddrs* one = all; one != nullptr; one = one->ifa_next)
  {
    if (one->ifa_addr != nullptr && (one->ifa_addr->sa_family == AF_INET || one->ifa_addr->sa_family == AF_INET6) &&
        bytesOf(one->ifa_addr) == address)
    {
      found.emplace_back(one->ifa_name);
    }
  }
  freeifaddrs(all);
  return found;
}

bool isOwn(const std::array<uint8_t, 16>& address)
{
  return isLoopback(address) || !interfacesOf(address).empty();
}

SocketAddress localOf(int fd)
{
  SocketAddress address;
  address.length = sizeof(address.storage);
  getsockname(fd, reinterpret_cast<sockaddr*>(&address.storage), &address.length);
  return address;
}

/// The interface through which the peer of an accepted socket came; empty: unknown.
std::string arrival(int fd, bool v4)
{
  const int level = v4 ? IPPROTO_IP : IPPROTO_IPV6;
  const int on = 1;
  setsockopt(fd, level, v4 ? IP_PKTINFO : IPV6_RECVPKTINFO, &on, sizeof(on));
  alignas(cmsghdr) std::array<char, 256> buffer{};
  auto length = static_cast<socklen_t>(buffer.size());
  if (getsockopt(fd, level, v4 ? IP_PKTOPTIONS : IPV6_2292PKTOPTIONS, buffer.data(), &length) != 0)
  {
    return "";
  }
  msghdr message{};
  message.msg_control = buffer.data();
  message.msg_controllen = length;
  unsigned index = 0;
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part))
  {
    if (v4 && part->cmsg_level == level && part->cmsg_type == IP_PKTINFO)
    {
      index = static_cast<unsigned>(reinterpret_cast<const in_pktinfo*>(CMSG_DATA(part))->ipi_ifindex);
    }
    else if (!v4 && part->cmsg_level == level && part->cmsg_type == IPV6_PKTINFO)
    {
      index = reinterpret_cast<const in6_pktinfo*>(CMSG_DATA(part))->ipi6_ifindex;
    }
  }
  char name[IF_NAMESIZE] = "";
  return index != 0 && if_indextoname(index, name) != nullptr ? name : "";
}

std::string bindToInterface(int fd, const std::string& name)
{
  return setsockopt(fd, SOL_SOCKET, SO_BINDTODEVICE, name.c_str(), static_cast<socklen_t>(name.size() + 1)) == 0
             ? ""
             : "cannot be bound to " + name + ": " + errorText(errno);
}

}  // namespace

void TrustedInterfaces::validate(const std::string& field) const
{
  for (const std::string& name : names_)
  {
    if (name.empty() || name.size() >= IF_NAMESIZE || name.find_first_of("/ \t\n*") != std::string::npos)
    {
      throw std::invalid_argument(field + " = \"" + name +
                                  "\", must be names of interfaces, as wg0; `ip link` shows them");
    }
  }
}

bool TrustedInterfaces::has(const std::string& name) const
{
  return name == LOOPBACK || std::find(names_.begin(), names_.end(), name) != names_.end();
}

std::string TrustedInterfaces::refusal(const std::string& what, const std::string& interface) const
{
  return what + (interface.empty() ? "an unknown interface" : interface) +
         ", where strangers can read pictures and forge answers. Use a tunnel and name its interface in "
         "trusted_interfaces, as [wg0], or a fleet over TLS: pi_edge fleet, transport: nats (docs/fleet.md)";
}

std::string TrustedInterfaces::admitOutgoing(int fd, const SocketAddress& address) const
{
  if (isOwn(bytesOf(address)))
  {
    return "";
  }
  // A datagram socket sends nothing when it connects, but takes the address of the interface that it would use.
  const pi_node::UniqueFd probe(socket(address.family(), SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!probe || connect(probe.get(), reinterpret_cast<const sockaddr*>(&address.storage), address.length) != 0)
  {
    return toText(address) + ": " + errorText(errno);
  }
  const std::vector<std::string> ways = interfacesOf(bytesOf(localOf(probe.get())));
  const auto way = std::find_if(ways.begin(), ways.end(), [this](const std::string& name) { return has(name); });
  if (way == ways.end())
  {
    return refusal(toText(address) + " is reached through ", ways.empty() ? "" : ways.front());
  }
  const std::string problem = bindToInterface(fd, *way);
  return problem.empty() ? "" : toText(address) + ": " + problem;
}

std::string TrustedInterfaces::admitIncoming(int fd, const SocketAddress& peer) const
{
  const std::array<uint8_t, 16> bytes = bytesOf(peer);
  if (isOwn(bytes))  // the kernel drops packets from elsewhere with this machine's addresses as source
  {
    return "";
  }
  const std::string interface = arrival(fd, isV4(bytes));
  if (!has(interface))
  {
    return refusal(toText(peer) + " is refused: it came through ", interface);
  }
  const std::string problem = bindToInterface(fd, interface);
  return problem.empty() ? "" : toText(peer) + ": " + problem;
}

std::string TrustedInterfaces::admitListener(int fd) const
{
  const SocketAddress address = localOf(fd);
  const std::array<uint8_t, 16> bytes = bytesOf(address);
  const bool anywhere =
      std::all_of(&bytes[isV4(bytes) ? 12 : 0], bytes.data() + 16, [](uint8_t one) { return one == 0; });
  const std::vector<std::string> owners = interfacesOf(bytes);
  if (anywhere || isLoopback(bytes) ||
      std::any_of(owners.begin(), owners.end(), [this](const std::string& name) { return has(name); }))
  {
    return "";
  }
  return refusal(toText(address) + " is an address of ", owners.empty() ? "" : owners.front());
}

}  // namespace pi_offload
