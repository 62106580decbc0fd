#include "master/http_server.h"

#include <sys/epoll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <map>
#include <utility>

#include "event_loop/if_alive.h"
#include "event_loop/socket_io.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t CHUNK_BYTES = 16 * 1024;
constexpr int MOST_CHUNKS_DRAINED = 64;

const char* reasonOf(int status)
{
  static const std::map<int, const char*> REASONS{{200, "OK"},
                                                  {404, "Not Found"},
                                                  {408, "Request Timeout"},
                                                  {411, "Length Required"},
                                                  {413, "Content Too Large"},
                                                  {415, "Unsupported Media Type"},
                                                  {431, "Request Header Fields Too Large"},
                                                  {501, "Not Implemented"},
                                                  {503, "Service Unavailable"}};
  const auto found = REASONS.find(status);
  return found != REASONS.end() ? found->second : "Bad Request";
}

std::string reply(int status, const char* type, bool keeps_alive, const std::string& body)
{
  std::string out = "HTTP/1.1 " + std::to_string(status) + " " + reasonOf(status) +
                    "\r\nServer: pi_master\r\nContent-Type: " + type +
                    "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n" +
                    (keeps_alive ? "" : "Connection: close\r\n") + "\r\n";
  return out += body;
}

}  // namespace

HttpServer::HttpServer(EventLoop* loop, const std::string& address, uint16_t port, Handler handler,
                       const HttpServerLimits& limits)
  : loop_(loop), limits_(limits), handler_(std::move(handler)), listener_(loop, address, port)
{
  listener_.start([this](FileDescriptor socket) { add(std::move(socket)); }, [this] { return dropLongestSilent(); });
}

HttpServer::~HttpServer()
{
  while (!connections_.empty())
  {
    drop(connections_.front());
  }
}

void HttpServer::add(FileDescriptor socket)
{
  if (connections_.size() >= limits_.connections)
  {
    dropLongestSilent();
  }
  auto connection = std::make_shared<Connection>();
  connection->socket = std::move(socket);
  connection->reader = HttpReader(HttpReader::Kind::REQUEST, limits_.message);
  connection->place = connections_.insert(connections_.end(), connection);
  connection->events = EPOLLIN;
  loop_->add(connection->socket.get(), EPOLLIN,
             [this, connection = connection.get()](uint32_t events) { onReady(*connection->place, events); });
}

bool HttpServer::dropLongestSilent()
{
  if (connections_.empty())
  {
    return false;
  }
  // Prefer one without a request: its client reconnects when needed.
  const auto idle = std::find_if(connections_.begin(), connections_.end(),
                                 [](const ConnectionPtr& connection)
                                 { return !connection->reader.hasBegun() && connection->out.empty(); });
  drop(idle != connections_.end() ? *idle : connections_.front());
  return true;
}

void HttpServer::onReady(const ConnectionPtr& watched, uint32_t events)
{
  const ConnectionPtr connection = watched;  // keeps the connection alive, although it may be dropped
  if (connection->events != EPOLLIN && (events & (EPOLLHUP | EPOLLERR)) != 0)
  {
    drop(connection);
  }
  else if (connection->events == EPOLLOUT)
  {
    send(connection);
  }
  else
  {
    receive(connection);
  }
}

void HttpServer::receive(const ConnectionPtr& connection)
{
  std::array<char, CHUNK_BYTES> chunk;
  const ssize_t size = recv(connection->socket.get(), chunk.data(), chunk.size(), 0);
  if (size > 0)
  {
    take(connection, std::string_view(chunk.data(), static_cast<size_t>(size)));
  }
  else if (size == 0 || (errno != EAGAIN && errno != EINTR))
  {
    drop(connection);
  }
}

void HttpServer::take(const ConnectionPtr& connection, std::string_view bytes)
{
  HttpReader& reader = connection->reader;
  const bool had_head = reader.hasHead();
  const size_t before = reader.body().size();
  const size_t used = reader.feed(bytes);
  bytes_in_ += reader.body().size();
  bytes_in_ -= before;
  connection->unread.assign(bytes.substr(used));
  if (reader.state() == HttpReader::State::FAILED)
  {
    refuse(connection, reader.status(), reader.problem());
  }
  else if (reader.state() == HttpReader::State::DONE)
  {
    answer(connection);
  }
  else if (bytes_in_ > limits_.bytes_in)
  {
    refuse(connection, 503, "requests of more than " + std::to_string(limits_.bytes_in) + " bytes at a time");
  }
  else if (reader.hasBegun())
  {
    if (!connection->deadline.running())
    {
      allow(connection, limits_.request);
    }
    if (!had_head && reader.hasHead() && reader.expectsContinue())
    {
      constexpr std::string_view GO_ON = "HTTP/1.1 100 Continue\r\n\r\n";
      ::send(connection->socket.get(), GO_ON.data(), GO_ON.size(), MSG_NOSIGNAL);  // nothing else is being sent
    }
  }
}

void HttpServer::answer(const ConnectionPtr& connection)
{
  const HttpReader& reader = connection->reader;
  if (reader.method() != "POST")
  {
    refuse(connection, 501, "this is a server of XML-RPC, which takes POST requests only");
    return;
  }
  if (reader.target() != "/" && reader.target() != "/RPC2" && !reader.target().empty())
  {
    refuse(connection, 404, "XML-RPC is served at / and /RPC2");
    return;
  }
  const std::string body = handler_(reader.body());
  if (bytes_out_ + body.size() > limits_.bytes_out)
  {
    refuse(connection, 503, "answers of more than " + std::to_string(limits_.bytes_out) + " bytes are waiting");
    return;
  }
  connection->closes = !reader.keepsAlive();
  setOut(connection, reply(200, "text/xml", reader.keepsAlive(), body));
  bytes_in_ -= reader.body().size();
  connection->reader.reset();
  connections_.splice(connections_.end(), connections_, connection->place);
  send(connection);
}

void HttpServer::refuse(const ConnectionPtr& connection, int status, const std::string& problem)
{
  setOut(connection, reply(status, "text/plain", false, problem + "\n"));
  connection->closes = true;
  bytes_in_ -= connection->reader.body().size();
  connection->reader.reset();
  connection->unread = std::string();
  send(connection);
}

void HttpServer::send(const ConnectionPtr& connection)
{
  switch (sendRest(connection->socket.get(), connection->out, &connection->sent))
  {
    case SendResult::BLOCKED:
      allow(connection, limits_.reply);
      watch(connection, EPOLLOUT);
      break;
    case SendResult::FAILED:
      drop(connection);
      break;
    case SendResult::DONE:
      onSent(connection);
      break;
  }
}

void HttpServer::onSent(const ConnectionPtr& connection)
{
  if (connection->closes)
  {
    // Read what the client has sent meanwhile: otherwise the kernel resets the connection and drops the answer.
    shutdown(connection->socket.get(), SHUT_WR);
    std::array<char, CHUNK_BYTES> rest;
    for (int count = 0; count < MOST_CHUNKS_DRAINED; ++count)
    {
      if (recv(connection->socket.get(), rest.data(), rest.size(), 0) <= 0)
      {
        break;
      }
    }
    drop(connection);
    return;
  }
  setOut(connection, std::string());
  connection->deadline.stop();
  if (connection->unread.empty())
  {
    watch(connection, EPOLLIN);
    return;
  }
  // In the next round: a client that pipelines requests must not block others, nor fill the stack.
  watch(connection, 0);
  loop_->defer(ifAlive(connection,
                       [this](const ConnectionPtr& waiting)
                       {
                         if (waiting->socket)
                         {
                           watch(waiting, EPOLLIN);
                           const std::string unread = std::exchange(waiting->unread, std::string());
                           take(waiting, unread);
                         }
                       }));
}

void HttpServer::setOut(const ConnectionPtr& connection, std::string out)
{
  bytes_out_ += out.size();
  bytes_out_ -= connection->out.size();
  connection->out = std::move(out);
  connection->sent = 0;
}

void HttpServer::watch(const ConnectionPtr& connection, uint32_t events)
{
  if (connection->events != events)
  {
    connection->events = events;
    loop_->change(connection->socket.get(), events);
  }
}

void HttpServer::allow(const ConnectionPtr& connection, std::chrono::milliseconds time)
{
  connection->deadline.start(
      loop_, time,
      ifAlive(connection, [this](const ConnectionPtr& late)
              { late->out.empty() ? refuse(late, 408, "the request was not complete in time") : drop(late); }));
}

void HttpServer::drop(const ConnectionPtr& dropped)
{
  const ConnectionPtr connection = dropped;
  if (!connection->socket)
  {
    return;
  }
  connection->deadline.stop();
  loop_->remove(connection->socket.get());
  bytes_in_ -= connection->reader.body().size();
  setOut(connection, std::string());
  connection->socket.reset();
  connections_.erase(connection->place);
}

}  // namespace pi_os_transport
