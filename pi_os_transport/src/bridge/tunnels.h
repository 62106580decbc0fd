#pragma once

#include <cstdint>
#include <string>

#include "bridge/bridge_request.h"
#include "bridge/sessions.h"

namespace pi_os_transport
{

/// The TCP connections of services that are carried between this device and others.
class Tunnels
{
public:
  Tunnels(BridgeContext* context, Sessions* sessions) : context_(context), sessions_(sessions) {}

  /// A service client of this device wants a connection to another device: answers on `channel` with a socket when the
  /// server is connected, or with REFUSED.
  void open(SideChannel channel, const BridgeRequest& request);
  /// Any TUNNEL frame. @return false if it is not acceptable
  bool onFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  /// The session is lost.
  static void abandon(Session* session);

private:
  void onReady(Session* session, uint32_t id);
  void refuse(Session* session, uint32_t id, const std::string& reason);
  bool accept(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  std::string connectToServer(Session* session, uint32_t id, const std::string& service, const Endpoint& server);
  void add(Session* session, Tunnel::Side side, uint32_t id, FileDescriptor socket, const std::string& target);
  uint64_t waitingBytes() const;

  BridgeContext* const context_;
  Sessions* const sessions_;
};

}  // namespace pi_os_transport
