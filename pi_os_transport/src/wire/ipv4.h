#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <optional>
#include <string>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Reads a numeric IPv4 address. @return host byte order
std::optional<uint32_t> parseIpv4(const std::string& text);
/// @param address  host byte order
std::string formatIpv4(uint32_t address);

/// The socket address of a numeric IPv4 address; any other text gives 0.0.0.0.
sockaddr_in socketAddress(const std::string& address, uint16_t port);
std::string addressText(const sockaddr_in& address);

/// The first IPv4 address of a host. Waits for a name server.
std::optional<std::string> hostAddress(const std::string& host);

/// True if the address belongs to this device.
bool isLocalAddress(const std::string& address);
bool isLoopbackAddress(const std::string& address);
/// The address of this device on its route to another one; empty if there is no route.
std::string addressTowards(const std::string& address, uint16_t port);

/// Makes a connected pair of TCP sockets on the loopback interface. roscpp accepts no other kind of socket.
bool makeTcpPair(FileDescriptor* one, FileDescriptor* other);

}  // namespace pi_os_transport
