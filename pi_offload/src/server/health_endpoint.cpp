#include "server/health_endpoint.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_node/unique_fd.h>
#include <pi_os_transport/sp_stream.h>

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <exception>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "wire/socket_tools.h"

namespace pi_offload
{
namespace
{

constexpr size_t MAX_REQUEST_BYTES = 8192;

std::string answer(int status, const char* reason, const std::string& type, const std::string& body, bool head_only)
{
  std::string text = "HTTP/1.1 " + std::to_string(status) + " " + reason + "\r\nContent-Type: " + type +
                     "\r\nContent-Length: " + std::to_string(body.size()) + "\r\nConnection: close\r\n";
  text += status == 405 ? "Allow: GET, HEAD\r\n\r\n" : "\r\n";
  return head_only ? text : text + body;
}

}  // namespace

void HealthEndpoint::Options::validate() const
{
  const pi_node::OptionCheck check("health");
  check.range<size_t>("max_connections", max_connections, 1, 10000);
  check.range("timeout_s", timeout_s, 0.01, 600.0);
}

struct HealthEndpoint::Impl
{
  struct Connection
  {
    pi_node::UniqueFd fd;
    int64_t until_ns = 0;
    std::string request;
    std::string response;
    size_t sent = 0;
    bool answered = false;  ///< the response is made
    bool finished = false;  ///< and sent
  };

  void run();
  void acceptAll();
  bool serve(Connection* connection);
  bool readRequest(Connection* connection);
  std::string respond(const std::string& request) const;

  Options options;
  Callbacks callbacks;
  WakeEvent wake;
  pi_node::UniqueFd listener;
  uint16_t port = 0;
  std::vector<Connection> connections;
  int64_t accept_again_ns = 0;
  std::atomic<bool> stop{false};
  std::thread thread;
};

/// @param request  up to the empty line; anything else is a bad request.
std::string HealthEndpoint::Impl::respond(const std::string& request) const
{
  const std::string plain = "text/plain; charset=utf-8";
  const std::string line = request.substr(0, request.find_first_of("\r\n"));
  const size_t first = line.find(' ');
  const size_t second = first == std::string::npos ? first : line.find(' ', first + 1);
  if (second == std::string::npos || line.compare(second + 1, 5, "HTTP/") != 0)
  {
    return answer(400, "Bad Request", plain, "no HTTP request\n", false);
  }
  const std::string method = line.substr(0, first);
  std::string path = line.substr(first + 1, second - first - 1);
  path = path.substr(0, path.find('?'));
  const bool head_only = method == "HEAD";
  if (method != "GET" && !head_only)
  {
    return answer(405, "Method Not Allowed", plain, "only GET and HEAD\n", false);
  }
  try
  {
    if (path == "/metrics")
    {
      return answer(200, "OK", "text/plain; version=0.0.4; charset=utf-8", callbacks.metrics(), head_only);
    }
    if (path == "/healthz" || path == "/readyz")
    {
      const bool live = path == "/healthz";
      const bool fine = live ? callbacks.live() : callbacks.ready();
      return fine ? answer(200, "OK", plain, live ? "live\n" : "ready\n", head_only)
                  : answer(503, "Service Unavailable", plain, live ? "not live\n" : "not ready\n", head_only);
    }
  }
  catch (const std::exception& error)
  {
    return answer(500, "Internal Server Error", plain, std::string(error.what()) + "\n", head_only);
  }
  return answer(404, "Not Found", plain, "there are /healthz, /readyz and /metrics\n", head_only);
}

/// @return false: the connection is over.
bool HealthEndpoint::Impl::readRequest(Connection* connection)
{
  char bytes[2048];
  const ssize_t count = recv(connection->fd.get(), bytes, sizeof(bytes), MSG_DONTWAIT);
  if (count == 0)
  {
    return false;
  }
  if (count < 0)
  {
    return pi_os_transport::isTemporary(errno);
  }
  if (connection->answered)
  {
    return true;  // further bytes are ignored
  }
  connection->request.append(bytes, static_cast<size_t>(count));
  const bool whole = connection->request.find("\r\n\r\n") != std::string::npos ||
                     connection->request.find("\n\n") != std::string::npos;
  if (whole || connection->request.size() > MAX_REQUEST_BYTES)
  {
    connection->response = whole ? respond(connection->request) : respond("");
    connection->request.clear();
    connection->answered = true;
  }
  return true;
}

/// @return false: the connection is over.
bool HealthEndpoint::Impl::serve(Connection* connection)
{
  if (!readRequest(connection))
  {
    return false;
  }
  while (connection->sent < connection->response.size())
  {
    const ssize_t count = send(connection->fd.get(), connection->response.data() + connection->sent,
                               connection->response.size() - connection->sent, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count < 0)
    {
      return pi_os_transport::isTemporary(errno);
    }
    connection->sent += static_cast<size_t>(count);
  }
  if (connection->answered && !connection->finished)
  {
    // The connection ends when the peer closes it or its time is over.
    connection->finished = true;
    shutdown(connection->fd.get(), SHUT_WR);
  }
  return true;
}

void HealthEndpoint::Impl::acceptAll()
{
  for (;;)
  {
    pi_node::UniqueFd fd(accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (!fd)
    {
      if (isShortage(errno))
      {
        accept_again_ns = pi_node::monotonicNs() + static_cast<int64_t>(ACCEPT_PAUSE_S * 1e9);
      }
      return;
    }
    if (connections.size() < options.max_connections)
    {
      connections.emplace_back();
      connections.back().fd = std::move(fd);
      connections.back().until_ns = pi_node::monotonicNs() + static_cast<int64_t>(options.timeout_s * 1e9);
    }
  }
}

void HealthEndpoint::Impl::run()
{
  std::vector<pollfd> watched;
  while (!stop)
  {
    int64_t next_ns = accept_again_ns != 0 ? accept_again_ns : INT64_MAX;
    watched.assign({{wake.fd(), POLLIN, 0}, {accept_again_ns != 0 ? -1 : listener.get(), POLLIN, 0}});
    for (const Connection& connection : connections)
    {
      const bool writes = connection.sent < connection.response.size();
      watched.push_back({connection.fd.get(), static_cast<short>(POLLIN | (writes ? POLLOUT : 0)), 0});
      next_ns = std::min(next_ns, connection.until_ns);
    }
    poll(watched.data(), watched.size(), pollTimeout(next_ns));
    const int64_t now_ns = pi_node::monotonicNs();
    for (size_t index = connections.size(); index-- > 0;)
    {
      Connection& connection = connections[index];
      if (now_ns >= connection.until_ns || (watched[index + 2].revents != 0 && !serve(&connection)))
      {
        connections.erase(connections.begin() + static_cast<std::ptrdiff_t>(index));
      }
    }
    if (watched[1].revents != 0)
    {
      acceptAll();
    }
    if (accept_again_ns != 0 && now_ns >= accept_again_ns)
    {
      accept_again_ns = 0;
    }
  }
}

HealthEndpoint::HealthEndpoint(const Options& options, Callbacks callbacks)
{
  options.validate();
  if (!callbacks.live || !callbacks.ready || !callbacks.metrics)
  {
    throw std::invalid_argument("health: a callback is missing, live, ready and metrics are needed");
  }
  impl_ = std::make_unique<Impl>();
  impl_->options = options;
  impl_->callbacks = std::move(callbacks);
  impl_->port = options.port;
  impl_->listener = listenOn(options.host, &impl_->port);
  impl_->thread = std::thread([impl = impl_.get()] { impl->run(); });
}

HealthEndpoint::~HealthEndpoint()
{
  impl_->stop = true;
  impl_->wake.wake();
  impl_->thread.join();
}

uint16_t HealthEndpoint::port() const
{
  return impl_->port;
}

}  // namespace pi_offload
