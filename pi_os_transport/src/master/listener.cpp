#include "master/listener.h"

#include <netdb.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "event_loop/socket_io.h"
#include "master/network_address.h"

namespace pi_os_transport
{
namespace
{

constexpr int BACKLOG = 1024;                    // limited to net.core.somaxconn by the kernel
constexpr int ACCEPTED_PER_ROUND = 64;           // so that a flood of connections does not block others
constexpr std::chrono::milliseconds PAUSE{200};  // when there are no descriptors left
constexpr int KEEP_ALIVE_IDLE_S = 60;
constexpr int KEEP_ALIVE_INTERVAL_S = 20;

}  // namespace

Listener::Listener(EventLoop* loop, const std::string& address, uint16_t port) : loop_(loop)
{
  SocketAddress own = findAddress(address, AI_NUMERICHOST).withPort(port);
  const std::string where = address + ", port " + std::to_string(port);
  if (own.size == 0)
  {
    throw std::runtime_error(address + " is no address to listen on");
  }
  socket_ = FileDescriptor(socket(own.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!socket_)
  {
    throw std::runtime_error("no socket for " + where + ": " + std::strerror(errno));
  }
  setOption(socket_.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  if (bind(socket_.get(), own.get(), own.size) != 0 || listen(socket_.get(), BACKLOG) != 0)
  {
    throw std::runtime_error("cannot listen on " + where + ": " + std::strerror(errno) +
                             (errno == EADDRINUSE ? "; end who uses it, or choose another port with -p" : ""));
  }
  getsockname(socket_.get(), own.get(), &own.size);
  port_ = own.port();
}

Listener::~Listener()
{
  loop_->remove(socket_.get());
}

void Listener::start(Accepted accepted, MakeRoom make_room)
{
  accepted_ = std::move(accepted);
  make_room_ = std::move(make_room);
  loop_->add(socket_.get(), EPOLLIN, [this](uint32_t) { accept(); });
}

void Listener::accept()
{
  for (int count = 0; count < ACCEPTED_PER_ROUND; ++count)
  {
    FileDescriptor connection(accept4(socket_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (!connection)
    {
      const bool is_full = errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM;
      if (is_full && make_room_())
      {
        continue;
      }
      if (is_full)
      {
        loop_->change(socket_.get(), 0);
        resume_.start(loop_, PAUSE, [this] { loop_->change(socket_.get(), EPOLLIN); });
      }
      return;  // otherwise no caller waits, or the caller has left
    }
    setOption(connection.get(), IPPROTO_TCP, TCP_NODELAY, 1);
    setOption(connection.get(), SOL_SOCKET, SO_KEEPALIVE, 1);
    setOption(connection.get(), IPPROTO_TCP, TCP_KEEPIDLE, KEEP_ALIVE_IDLE_S);
    setOption(connection.get(), IPPROTO_TCP, TCP_KEEPINTVL, KEEP_ALIVE_INTERVAL_S);
    accepted_(std::move(connection));
  }
}

}  // namespace pi_os_transport
