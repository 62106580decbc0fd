#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "bridge/bridge_context.h"
#include "bridge/bridge_request.h"
#include "bridge/incoming_stream.h"
#include "bridge/outgoing_stream.h"
#include "bridge/peer.h"
#include "bridge/tunnel.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// A process of this device that waits for a tunnel.
struct TunnelRequest
{
  SideChannel channel;
  BridgeRequest wish;
  Timer deadline;
};

/// One other bridge and everything that is carried to it and from it.
struct Session
{
  static constexpr size_t MAX_LINKS = 4096;    ///< in each direction
  static constexpr size_t MAX_STREAMS = 4096;  ///< likewise

  std::shared_ptr<Peer> peer;
  std::string identity;  ///< name or key id that the other bridge has proved to have; empty without protection
  std::map<uint32_t, std::shared_ptr<OutgoingLink>> outgoing;
  std::map<std::string, std::shared_ptr<OutgoingStream>> outgoing_streams;  ///< by publisher's process and topic
  std::map<uint32_t, std::shared_ptr<IncomingLink>> incoming;
  std::map<uint32_t, std::shared_ptr<IncomingStream>> incoming_streams;
  std::map<uint32_t, std::shared_ptr<Tunnel>> tunnels;                 ///< by the id in frames that come from the peer
  std::map<uint32_t, std::shared_ptr<TunnelRequest>> tunnel_requests;  ///< likewise, until the peer has connected
  std::set<uint32_t> tunnel_checks;  ///< likewise; the peer asked for them, and the ROS master is being asked
};

/// The table of sessions, one per bridge that this one knows.
class Sessions
{
public:
  /// @param listener  of all peers
  Sessions(BridgeContext* context, Peer::Listener* listener) : context_(context), listener_(listener) {}

  /// Connects to the configured peers, and from now on forgets bridges that only introduced themselves.
  void start();

  /// The session with the bridge at `endpoint`, made if there is none. Null if there are too many.
  Session* at(const Endpoint& endpoint);
  /// The same for the bridge of a device. Null also if that device is not allowed here.
  Session* ofDevice(const std::string& address);
  /// Null if there is none.
  Session* of(const Peer* peer) const;
  Session* withSecret(uint64_t secret) const;
  Session* find(const Endpoint& endpoint) const;
  Session* withConnection(FrameTransport::ConnectionId connection) const;
  /// True if the device was configured, or was found before.
  bool knows(const std::string& address) const;
  /// Null if there are no sessions.
  Session* first() const { return table_.empty() ? nullptr : table_.begin()->second.get(); }
  void remove(const Endpoint& endpoint) { table_.erase(endpoint); }

  const std::map<Endpoint, std::unique_ptr<Session>>& all() const { return table_; }
  /// Calls `visit(session, link)` for every link of a subscriber on this device.
  template <typename Visit>
  void forEachIncoming(Visit visit) const
  {
    for (const auto& session : table_)
    {
      for (const auto& link : session.second->incoming)
      {
        visit(session.second.get(), link.second);
      }
    }
  }

private:
  void removeStale();

  BridgeContext* const context_;
  Peer::Listener* const listener_;
  std::map<Endpoint, std::unique_ptr<Session>> table_;
  Timer stale_timer_;
};

}  // namespace pi_os_transport
