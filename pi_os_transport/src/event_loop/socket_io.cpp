#include "event_loop/socket_io.h"

#include <netinet/in.h>

#include <cerrno>
#include <utility>

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

FileDescriptor beginConnecting(const sockaddr* address, socklen_t size)
{
  FileDescriptor connection(socket(address->sa_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP));
  const bool begun = connect(connection.get(), address, size) == 0 || errno == EINPROGRESS;
  return begun ? std::move(connection) : FileDescriptor();
}

int connectionError(int socket)
{
  int error = 0;
  socklen_t length = sizeof(error);
  getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &length);
  return error;
}

void setOption(int socket, int level, int name, int value)
{
  setsockopt(socket, level, name, &value, sizeof(value));
}

}  // namespace pi_os_transport
