#include "wire/ipv4.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <sys/socket.h>

#include <memory>
#include <utility>

namespace pi_os_transport
{
namespace
{

const sockaddr* generic(const sockaddr_in& address)
{
  return reinterpret_cast<const sockaddr*>(&address);
}

bool readOwnAddress(const FileDescriptor& socket, sockaddr_in* address)
{
  socklen_t length = sizeof(*address);
  return getsockname(socket.get(), reinterpret_cast<sockaddr*>(address), &length) == 0;
}

}  // namespace

std::optional<uint32_t> parseIpv4(const std::string& text)
{
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1 ? std::optional<uint32_t>(ntohl(address.s_addr))
                                                         : std::nullopt;
}

std::string formatIpv4(uint32_t address)
{
  const in_addr network{htonl(address)};
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &network, text, sizeof(text));
  return text;
}

sockaddr_in socketAddress(const std::string& address, uint16_t port)
{
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(port);
  result.sin_addr.s_addr = htonl(parseIpv4(address).value_or(INADDR_ANY));
  return result;
}

std::string addressText(const sockaddr_in& address)
{
  return formatIpv4(ntohl(address.sin_addr.s_addr));
}

std::optional<std::string> hostAddress(const std::string& host)
{
  addrinfo wanted{};
  wanted.ai_family = AF_INET;
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  if (getaddrinfo(host.c_str(), nullptr, &wanted, &list) != 0)
  {
    return std::nullopt;
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(list, &freeaddrinfo);
  return addressText(*reinterpret_cast<const sockaddr_in*>(list->ai_addr));
}

bool isLocalAddress(const std::string& address)
{
  // A socket can be bound only to an address of this device.
  const FileDescriptor probe(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const sockaddr_in local = socketAddress(address, 0);
  return local.sin_addr.s_addr != INADDR_ANY && bind(probe.get(), generic(local), sizeof(local)) == 0;
}

bool isLoopbackAddress(const std::string& address)
{
  return parseIpv4(address).value_or(INADDR_ANY) >> 24 == IN_LOOPBACKNET;
}

std::string addressTowards(const std::string& address, uint16_t port)
{
  const FileDescriptor probe(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const sockaddr_in remote = socketAddress(address, port);
  sockaddr_in local{};
  return connect(probe.get(), generic(remote), sizeof(remote)) == 0 && readOwnAddress(probe, &local)
             ? addressText(local)
             : "";
}

bool makeTcpPair(FileDescriptor* one, FileDescriptor* other)
{
  const FileDescriptor listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  FileDescriptor client(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address = socketAddress("127.0.0.1", 0);
  if (bind(listener.get(), generic(address), sizeof(address)) != 0 || listen(listener.get(), 1) != 0 ||
      !readOwnAddress(listener, &address) || connect(client.get(), generic(address), sizeof(address)) != 0)
  {
    return false;
  }
  sockaddr_in expected{};
  readOwnAddress(client, &expected);
  sockaddr_in from{};
  socklen_t length = sizeof(from);
  FileDescriptor accepted(accept4(listener.get(), reinterpret_cast<sockaddr*>(&from), &length, SOCK_CLOEXEC));
  if (!accepted || from.sin_port != expected.sin_port || from.sin_addr.s_addr != expected.sin_addr.s_addr)
  {
    return false;  // another process connected first
  }
  *one = std::move(client);
  *other = std::move(accepted);
  return true;
}

}  // namespace pi_os_transport
