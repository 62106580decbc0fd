#pragma once

#include <functional>
#include <memory>
#include <string>

#include "event_loop/event_loop.h"
#include "rosout/tcpros_header.h"
#include "shm/file_descriptor.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{

/// Asks a TCP port whether a service is served there, as `rosservice type` does. A registration may be older than the
/// process that listens now.
class ServiceProbe : public std::enable_shared_from_this<ServiceProbe>
{
public:
  /// Gets true if the server answered with the header of this service.
  using Done = std::function<void(bool served)>;

  /// @param service  a valid name: other bytes could be a command for a foreign program
  ServiceProbe(EventLoop* loop, const std::string& service, Done done);
  ~ServiceProbe();

  /// Calls `done` once, not before this call has returned.
  void start(const Endpoint& server);

private:
  void onReady(uint32_t events);
  void receive();
  void finish(bool served);

  EventLoop* const loop_;
  Done done_;
  FileDescriptor socket_;
  const std::string request_;
  size_t sent_ = 0;
  TcprosReader reader_;
  Timer deadline_;
};

/// True for the global name of a service or node: no other characters than ROS allows.
bool isGraphName(const std::string& name);

}  // namespace pi_os_transport
