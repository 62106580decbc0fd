#include "wire/sp_socket.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <cerrno>

#include "event_loop/socket_io.h"

namespace pi_os_transport
{

void setCommonOptions(int fd)
{
  setOption(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  setOption(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
  setOption(fd, IPPROTO_TCP, TCP_KEEPIDLE, 2);
  setOption(fd, IPPROTO_TCP, TCP_KEEPINTVL, 1);
  setOption(fd, IPPROTO_TCP, TCP_KEEPCNT, 3);
}

CloseReason reasonOf(int error)
{
  switch (error)
  {
    case ECONNREFUSED:
      return CloseReason::REFUSED;
    case ECONNRESET:
    case ECONNABORTED:
    case EPIPE:
      return CloseReason::PEER_CLOSED;
    default:
      return CloseReason::UNREACHABLE;
  }
}

bool isTemporary(int error)
{
  return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

bool sendGreeting(int fd, const std::array<uint8_t, GREETING_BYTES>& greeting)
{
  // A new connection always has room for the greeting.
  return send(fd, greeting.data(), greeting.size(), MSG_NOSIGNAL | MSG_DONTWAIT) ==
         static_cast<ssize_t>(greeting.size());
}

}  // namespace pi_os_transport
