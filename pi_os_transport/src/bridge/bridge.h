#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "bridge/bridge_config.h"
#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"
#include "image_codec/image_codec.h"
#include "bridge/incoming_stream.h"
#include "bridge/outgoing_stream.h"
#include "bridge/peer.h"
#include "bridge/bridge_request.h"
#include "shm/side_channel.h"
#include "shm/slot_pool.h"
#include "bridge/tunnel.h"

namespace pi_os_transport
{

/// The bridge of one device: serves the nodes here, and the bridges of other devices (docs/design/device_bridge.md).
/// Everything happens on the thread of the event loop.
class Bridge : private FrameTransport::Listener, private Peer::Listener
{
public:
  /// @param log  gets one line per event that an operator wants to know.
  Bridge(EventLoop* loop, BridgeConfig config, std::function<void(const std::string&)> log);
  ~Bridge() override;

  /// Begins to serve. @throws std::runtime_error if an address or the name is taken.
  void start();
  /// Lets arrive what is under way, hands all links back to TCPROS, and calls `done`; takes at most half a second.
  void drain(std::function<void()> done);

  uint16_t port() const { return transport_->port(); }
  const BridgeConfig& config() const { return config_; }
  /// Counters and states as JSON.
  std::string status() const;

private:
  struct Refused
  {
    uint64_t unknown_peer = 0;
    uint64_t wrong_version = 0;
    uint64_t oversized = 0;
    uint64_t malformed = 0;
    uint64_t bad_session = 0;
  };
  struct Session
  {
    std::shared_ptr<Peer> peer;
    std::map<uint32_t, std::shared_ptr<OutgoingLink>> outgoing;
    std::map<std::string, std::shared_ptr<OutgoingStream>> outgoing_streams;  ///< by publisher's process and topic
    std::map<uint32_t, std::shared_ptr<IncomingLink>> incoming;
    std::map<uint32_t, std::shared_ptr<IncomingStream>> incoming_streams;
    std::map<uint32_t, std::shared_ptr<Tunnel>> tunnels;  ///< by the id in frames that come from the peer
  };
  struct Client;

  // FrameTransport::Listener
  void onConnected(FrameTransport::ConnectionId connection) override;
  void onWritable(FrameTransport::ConnectionId connection) override;
  void onClosed(FrameTransport::ConnectionId connection, CloseReason reason) override;
  bool onAccept(const std::string& address) override;
  uint8_t* onHeader(FrameTransport::SourceId source, const FrameHeader& header, uint32_t length) override;
  void onFrame(FrameTransport::SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) override;
  void onSourceClosed(FrameTransport::SourceId source, CloseReason reason, const std::string& detail) override;

  // Peer::Listener
  Hello describe(const Endpoint& towards) override;
  void onUp(Peer* peer, bool resumed) override;
  void onInterrupted(Peer* peer) override;
  void onLost(Peer* peer, bool hung) override;

  // Nodes of this device.
  void acceptClients();
  void onClient(const std::shared_ptr<Client>& client);
  void answerStatus(SideChannel* channel);
  void openTunnel(SideChannel* channel, const BridgeRequest& request);
  void openIncoming(SideChannel channel, const BridgeRequest& request);
  void onSubscriber(Session* session, const std::shared_ptr<IncomingLink>& link);
  void offerTo(Session* session, const std::shared_ptr<IncomingLink>& link);
  void endIncoming(Session* session, const std::shared_ptr<IncomingLink>& ended, LinkEnd reason, bool tell_peer);
  void pauseBlocked();

  // Publishers of this device.
  void openOutgoing(Session* session, uint32_t id, const LinkOpen& open);
  void onPublisher(Session* session, const std::shared_ptr<OutgoingLink>& link);
  void onDoorbell(const std::shared_ptr<OutgoingLink>& link);
  void endOutgoing(Session* session, const std::shared_ptr<OutgoingLink>& link, LinkEnd reason,
                   const std::string& text);
  void closeOutgoing(Session* session, const std::shared_ptr<OutgoingLink>& link);
  void forgetOutgoing(Session* session, const std::shared_ptr<OutgoingLink>& link);
  std::shared_ptr<OutgoingStream> streamFor(Session* session, const LinkOpen& open);

  // Other bridges.
  Session* sessionFor(const Endpoint& endpoint);
  Session* sessionOf(const Peer* peer);
  Session* findSession(const std::string& address);
  Session* sessionBySecret(uint64_t secret);
  Session* introduce(FrameTransport::SourceId source, const Hello& hello);
  bool onPeerFrame(Session* session, const FrameHeader& header, uint8_t* payload, uint32_t length);
  bool onLinkFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  bool onStreamFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  bool onTunnelFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  uint64_t tunnelBytes() const;
  bool acceptTunnel(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  void addTunnel(Session* session, Tunnel::Side side, uint32_t id, FileDescriptor socket, const std::string& target);
  void refuse(uint64_t* counter, const std::string& what);
  void removeStalePeers();
  void finishDraining();
  bool drained() const;

  EventLoop* const loop_;
  const BridgeConfig config_;
  const std::function<void(const std::string&)> log_;
  const uint64_t instance_;
  const Token pool_token_ = Token::random();
  std::unique_ptr<SlotPool> pool_;
  std::unique_ptr<FrameTransport> transport_;
  std::unique_ptr<ImageCodec> codec_;
  SideChannel listener_;
  std::map<int, std::shared_ptr<Client>> clients_;  ///< whose first packet has not come yet
  std::map<Endpoint, std::unique_ptr<Session>> sessions_;
  uint32_t next_id_ = 1;
  Refused refused_;
  std::map<std::string, SteadyTime> logged_;  ///< refusals by text: each is logged once a minute at most
  std::map<FrameTransport::SourceId, std::vector<uint8_t>> payloads_;  ///< for frames that have no better place
  /// Keeps the place of a fragment that is being received, whatever happens to its stream meanwhile.
  std::map<FrameTransport::SourceId, std::shared_ptr<uint8_t>> fragments_;
  EventLoop::TimerId blocked_timer_ = 0;
  EventLoop::TimerId stale_timer_ = 0;
  std::function<void()> on_drained_;
  SteadyTime drain_deadline_;
};

}  // namespace pi_os_transport
