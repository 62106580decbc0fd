#pragma once

#include <cstddef>
#include <string_view>

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

/// Result of connecting a socket that does not block. @return error number; 0: connected
int connectionError(int socket);

}  // namespace pi_os_transport
