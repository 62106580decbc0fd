#include "event_loop/socket_io.h"

#include <sys/socket.h>

#include <cerrno>

namespace pi_os_transport
{

SendResult sendRest(int socket, std::string_view data, size_t* sent)
{
  while (*sent < data.size())
  {
    const ssize_t size = send(socket, data.data() + *sent, data.size() - *sent, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (size >= 0)
    {
      *sent += static_cast<size_t>(size);
    }
    else if (errno != EINTR)
    {
      return errno == EAGAIN || errno == EWOULDBLOCK ? SendResult::BLOCKED : SendResult::FAILED;
    }
  }
  return SendResult::DONE;
}

int connectionError(int socket)
{
  int error = 0;
  socklen_t length = sizeof(error);
  getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &length);
  return error;
}

}  // namespace pi_os_transport
