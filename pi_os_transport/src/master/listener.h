#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Accepts TCP connections on a loop. Must outlive the loop's run.
class Listener
{
public:
  using Accepted = std::function<void(FileDescriptor connection)>;
  /// Frees a descriptor because none is left. @return false if this is impossible.
  using MakeRoom = std::function<bool()>;

  /// @param address  numeric. @param port  0: any free port.
  /// @throws std::runtime_error naming address and port, and the remedy if the port is in use
  Listener(EventLoop* loop, const std::string& address, uint16_t port);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  uint16_t port() const { return port_; }
  /// Accepted connections are non-blocking, with TCP_NODELAY and keep-alive.
  void start(Accepted accepted, MakeRoom make_room);

private:
  void accept();

  EventLoop* loop_;
  FileDescriptor socket_;
  uint16_t port_ = 0;
  Accepted accepted_;
  MakeRoom make_room_;
  Timer resume_;
};

}  // namespace pi_os_transport
