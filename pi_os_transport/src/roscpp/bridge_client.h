#pragma once

#include <ros/connection.h>
#include <ros/transport/transport_tcp.h>
#include <sys/socket.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "bridge/bridge_request.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

class ReceiveLink;

/// This process's way to the bridge of its device. Thread safe.
class BridgeClient
{
public:
  static BridgeClient& instance();

  /// Lets `link` ask for a bridge until one answers: after `delay`, then about three times a second.
  void want(const std::shared_ptr<ReceiveLink>& link, std::chrono::milliseconds delay);

  /// A new connection to the bridge with `request` sent on it. Empty if no bridge answers, or none is wanted.
  SideChannel connect(const BridgeRequest& request) const;

  /// Asks the bridge for a TCP connection to `host` (name or numeric) and `port` on another device. Waits at most 100
  /// ms for the bridge.
  /// @return a connected TCP socket; empty if the bridge cannot help.
  FileDescriptor openTunnel(const std::string& host, uint16_t port, const std::string& service) const;

  /// Drops a TCPROS connection, which makes roscpp connect anew, as soon as the publisher's machine accepts
  /// connections: roscpp gives up for good if its own attempt fails at once.
  void reconnect(const ros::ConnectionPtr& connection);

  /// Watches over a connection through a tunnel: should the bridge of this device hang, it is closed, which its user
  /// sees as the death of the server.
  void guard(const boost::shared_ptr<ros::TransportTCP>& transport);

  /// Numeric address of the machine at the other end of a TCP socket, if it may be another device than this: not a
  /// loopback address. Else empty.
  static std::string peerAddress(int socket);

private:
  BridgeClient() = default;
  void startPolling();  // with mutex_ held
  void poll();
  void pollWishes();
  void pollTunnels();
  void pollReconnects();

  std::mutex mutex_;
  bool polling_ = false;
  struct Wish
  {
    std::weak_ptr<ReceiveLink> link;
    std::chrono::steady_clock::time_point not_before;
  };
  std::vector<Wish> wishes_;
  std::chrono::steady_clock::time_point next_try_;

  struct Reconnect
  {
    boost::weak_ptr<ros::Connection> connection;
    sockaddr_storage address;
    socklen_t length;
    FileDescriptor probe;  ///< a connection attempt; network thread
    std::chrono::steady_clock::time_point until;
  };
  std::vector<Reconnect> reconnects_;

  std::vector<boost::weak_ptr<ros::TransportTCP>> tunnels_;
  SideChannel ping_;  ///< while an answer is awaited; network thread
  std::chrono::steady_clock::time_point ping_time_;
};

}  // namespace pi_os_transport
