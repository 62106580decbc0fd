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

}  // namespace pi_os_transport
