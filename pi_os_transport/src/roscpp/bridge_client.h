#pragma once

#include <ros/connection.h>
#include <ros/transport/transport_tcp.h>
#include <sys/socket.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "bridge/bridge_request.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

class ReceiveLink;

/// Connects this process to the bridge of its device. Thread safe.
class BridgeClient
{
public:
  static BridgeClient& instance();

  /// Lets `link` ask for a bridge until one answers: first after `delay`, then every 300 ms.
  void want(const std::shared_ptr<ReceiveLink>& link, std::chrono::milliseconds delay);

  /// Connects to the bridge and sends `request`. Empty if no bridge runs, or none is wanted.
  SideChannel connect(const BridgeRequest& request) const;

  /// Asks the bridge for a TCP connection to `host` (name or number) and `port` on another device. Waits at most 600
  /// ms.
  /// @return a connected TCP socket; empty if the bridge refuses or does not answer
  FileDescriptor openTunnel(const std::string& host, uint16_t port, const std::string& service) const;

  /// Drops a TCPROS connection, so that roscpp reconnects. Waits until the publisher's machine accepts connections,
  /// because roscpp never tries again if its attempt fails at once. Not if the bridges carry the link again by then.
  void reconnect(const ros::ConnectionPtr& connection);

  /// Watches a connection through a tunnel. Closes it if the bridge of this device hangs; to its user, the server has
  /// then died.
  void guard(const boost::shared_ptr<ros::TransportTCP>& transport);

  /// True if the bridge is required for this connection: it leads to another device, and PI_OS_REQUIRE_BRIDGE is set.
  static bool isRequiredFor(const ros::ConnectionPtr& connection);
  /// The same for a host.
  static bool isRequiredFor(const std::string& host);

  /// Says once per subject what PI_OS_REQUIRE_BRIDGE prevents, and the way out.
  void warnOfRequired(const std::string& subject, const std::string& text);

  /// Numeric address of the peer of a TCP socket; empty for a loopback address, which cannot be another device.
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
  std::set<std::string> warned_;

  std::vector<boost::weak_ptr<ros::TransportTCP>> tunnels_;
  SideChannel ping_;  ///< while waiting for an answer; network thread
  std::chrono::steady_clock::time_point ping_time_;
};

}  // namespace pi_os_transport
