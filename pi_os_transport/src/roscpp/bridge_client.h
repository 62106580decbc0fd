#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "pi_os_transport/bridge_request.h"
#include "pi_os_transport/side_channel.h"

namespace pi_os_transport
{

class ReceiveLink;

/// This process's way to the bridge of its device. Thread safe.
class BridgeClient
{
public:
  static BridgeClient& instance();

  /// Lets `link` ask for a bridge until one answers: soon, then about three times a second.
  void want(const std::shared_ptr<ReceiveLink>& link);

  /// A new connection to the bridge with `request` sent on it. Empty if no bridge answers, or none is wanted.
  SideChannel connect(const BridgeRequest& request) const;

  /// Asks the bridge for a TCP connection to `address` (numeric) and `port` on another device. Waits at most 100 ms.
  /// @return a connected TCP socket; empty if the bridge cannot help.
  FileDescriptor openTunnel(const std::string& address, uint16_t port, const std::string& service) const;

  /// Numeric address of the machine at the other end of a TCP socket, if it may be another device than this: not a
  /// loopback address. Else empty.
  static std::string peerAddress(int socket);

private:
  BridgeClient() = default;
  void poll();

  std::mutex mutex_;
  bool polling_ = false;
  std::vector<std::weak_ptr<ReceiveLink>> wanting_;
  std::chrono::steady_clock::time_point next_try_;
};

}  // namespace pi_os_transport
