#include "master/listener.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace pi_os_transport
{
namespace
{

constexpr int BACKLOG = 1024;                    // cut to net.core.somaxconn by the kernel
constexpr int ACCEPTED_PER_ROUND = 64;           // so that a flood of connections lets others be served
constexpr std::chrono::milliseconds PAUSE{200};  // when there is no descriptor for one more
constexpr int KEEP_ALIVE_IDLE_S = 60;
constexpr int KEEP_ALIVE_INTERVAL_S = 20;

void setOption(int fd, int level, int option, int value)
{
  setsockopt(fd, level, option, &value, sizeof(value));  // a connection without is no worse than a slow one
}

}  // namespace

Listener::Listener(EventLoop* loop, const std::string& address, uint16_t port) : loop_(loop)
{
  const bool ipv6 = address.find(':') != std::string::npos;
  sockaddr_storage storage{};
  socklen_t size = 0;
  bool is_numeric = false;
  if (ipv6)
  {
    auto* const in = reinterpret_cast<sockaddr_in6*>(&storage);
    in->sin6_family = AF_INET6;
    in->sin6_port = htons(port);
    is_numeric = inet_pton(AF_INET6, address.c_str(), &in->sin6_addr) == 1;
    size = sizeof(*in);
  }
  else
  {
    auto* const in = reinterpret_cast<sockaddr_in*>(&storage);
    in->sin_family = AF_INET;
    in->sin_port = htons(port);
    is_numeric = inet_pton(AF_INET, address.c_str(), &in->sin_addr) == 1;
    size = sizeof(*in);
  }
  const std::string where = address + ", port " + std::to_string(port);
  if (!is_numeric)
  {
    throw std::runtime_error(address + " is no address to listen on");
  }
  socket_ = FileDescriptor(socket(storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!socket_)
  {
    throw std::runtime_error("no socket for " + where + ": " + std::strerror(errno));
  }
  setOption(socket_.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  if (bind(socket_.get(), reinterpret_cast<sockaddr*>(&storage), size) != 0 || listen(socket_.get(), BACKLOG) != 0)
  {
    throw std::runtime_error("cannot listen on " + where + ": " + std::strerror(errno) +
                             (errno == EADDRINUSE ? "; end who uses it, or choose another port with -p" : ""));
  }
  size = sizeof(storage);
  getsockname(socket_.get(), reinterpret_cast<sockaddr*>(&storage), &size);
  port_ = ntohs(ipv6 ? reinterpret_cast<sockaddr_in6*>(&storage)->sin6_port
                     : reinterpret_cast<sockaddr_in*>(&storage)->sin_port);
}

Listener::~Listener()
{
  loop_->cancel(resume_);
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
        pause();
      }
      return;  // else nobody waits, or who waited has left
    }
    setOption(connection.get(), IPPROTO_TCP, TCP_NODELAY, 1);
    setOption(connection.get(), SOL_SOCKET, SO_KEEPALIVE, 1);
    setOption(connection.get(), IPPROTO_TCP, TCP_KEEPIDLE, KEEP_ALIVE_IDLE_S);
    setOption(connection.get(), IPPROTO_TCP, TCP_KEEPINTVL, KEEP_ALIVE_INTERVAL_S);
    accepted_(std::move(connection));
  }
}

void Listener::pause()
{
  loop_->change(socket_.get(), 0);
  resume_ = loop_->after(PAUSE, [this] { loop_->change(socket_.get(), EPOLLIN); });
}

}  // namespace pi_os_transport
