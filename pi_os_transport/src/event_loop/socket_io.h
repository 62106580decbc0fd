#pragma once

#include <sys/socket.h>

#include <cstddef>
#include <string_view>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

enum class SendResult
{
  DONE,
  BLOCKED,  ///< the socket accepts no more now
  FAILED,
};
/// Sends `data` from position `*sent` on over a socket that does not block, and advances `*sent`.
SendResult sendRest(int socket, std::string_view data, size_t* sent);

/// Begins to connect over TCP. @return a socket that does not block; empty if this is impossible, with errno set
FileDescriptor beginConnecting(const sockaddr* address, socklen_t size);
/// Result of connecting a socket that does not block. @return error number; 0: connected
int connectionError(int socket);

/// Sets a socket option that is an optional improvement: failure is ignored.
void setOption(int socket, int level, int name, int value);

}  // namespace pi_os_transport
