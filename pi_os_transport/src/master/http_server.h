#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <string_view>

#include "event_loop/event_loop.h"
#include "master/http_reader.h"
#include "master/listener.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Resources that clients may use.
struct HttpServerLimits
{
  HttpLimits message;
  size_t connections = 4096;                 ///< the connection that was silent longest is replaced
  size_t bytes_in = 128 * 1024 * 1024;       ///< of incomplete requests of all connections
  size_t bytes_out = 256 * 1024 * 1024;      ///< of answers that clients have not read
  std::chrono::milliseconds request{30000};  ///< from first to last byte
  std::chrono::milliseconds reply{30000};    ///< without progress
};

/// Serves POST requests of HTTP/1.1 on a loop, one after the other on each connection, and keeps connections open.
/// Closes the connection of a client that sends invalid data, too much or too slowly, or does not read its answers;
/// other clients are not affected. Must outlive the loop's run.
class HttpServer
{
public:
  /// @return the body of the answer, which is text/xml. Must not throw.
  using Handler = std::function<std::string(std::string_view body)>;

  HttpServer(EventLoop* loop, const std::string& address, uint16_t port, Handler handler,
             const HttpServerLimits& limits = HttpServerLimits());
  ~HttpServer();

  uint16_t port() const { return listener_.port(); }
  size_t connections() const { return connections_.size(); }

private:
  struct Connection
  {
    FileDescriptor socket;
    HttpReader reader{HttpReader::Kind::REQUEST};
    std::string unread;  ///< received behind the current request
    std::string out;
    size_t sent = 0;
    bool closes = false;  ///< closes when `out` is sent
    uint32_t events = 0;  ///< watched by the loop
    Timer deadline;
    std::list<std::shared_ptr<Connection>>::iterator place;
  };
  using ConnectionPtr = std::shared_ptr<Connection>;

  void add(FileDescriptor socket);
  bool dropLongestSilent();
  void onReady(const ConnectionPtr& connection, uint32_t events);
  void receive(const ConnectionPtr& connection);
  void take(const ConnectionPtr& connection, std::string_view bytes);
  void answer(const ConnectionPtr& connection);
  void refuse(const ConnectionPtr& connection, int status, const std::string& problem);
  void send(const ConnectionPtr& connection);
  void onSent(const ConnectionPtr& connection);
  void setOut(const ConnectionPtr& connection, std::string out);
  void watch(const ConnectionPtr& connection, uint32_t events);
  void allow(const ConnectionPtr& connection, std::chrono::milliseconds time);
  void drop(const ConnectionPtr& connection);

  EventLoop* loop_;
  HttpServerLimits limits_;
  Handler handler_;
  std::list<ConnectionPtr> connections_;  ///< the one silent longest is first
  size_t bytes_in_ = 0;
  size_t bytes_out_ = 0;
  Listener listener_;
};

}  // namespace pi_os_transport
