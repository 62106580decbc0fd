#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "bridge/bridge_context.h"
#include "bridge/frame_dispatcher.h"
#include "bridge/incoming_links.h"
#include "bridge/local_pairs.h"
#include "bridge/local_requests.h"
#include "bridge/outgoing_links.h"
#include "bridge/sessions.h"
#include "bridge/tunnels.h"

namespace pi_os_transport
{

/// The bridge of one device: serves the nodes of this device and the bridges of others
/// (docs/design/device_bridge.md). Owns the parts of a bridge and connects them.
/// Everything runs on the thread of the event loop.
class Bridge : private Peer::Listener
{
public:
  /// @param log  gets one line per event that an operator wants to know.
  Bridge(EventLoop* loop, BridgeConfig config, std::function<void(const std::string&)> log);
  ~Bridge() override;

  /// Begins to serve. @throws std::runtime_error if an address or the name is taken.
  void start();
  /// Lets arrive what is under way, hands all links back to TCPROS, and calls `done`. Takes at most half a second.
  void drain(std::function<void()> done);

  uint16_t port() const { return context_.transport->port(); }
  const BridgeConfig& config() const { return context_.config; }
  /// Counters and states as JSON.
  std::string status() const;

private:
  // Peer::Listener
  Hello describe(const Endpoint& towards) override;
  void onUp(Peer* peer, bool resumed) override;
  void onInterrupted(Peer* peer) override;
  void onLost(Peer* peer, bool hung) override;
  bool holdsLast(const Peer* peer) const override;

  void finishDraining();
  bool drained() const;

  BridgeContext context_;
  Sessions sessions_;
  LocalPairs pairs_;
  IncomingLinks incoming_;
  OutgoingLinks outgoing_;
  Tunnels tunnels_;
  FrameDispatcher dispatcher_;
  LocalRequests requests_;
  std::function<void()> on_drained_;
  SteadyTime drain_deadline_;
};

}  // namespace pi_os_transport
