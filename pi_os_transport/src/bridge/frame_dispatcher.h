#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bridge/incoming_links.h"
#include "bridge/outgoing_links.h"
#include "bridge/sessions.h"
#include "bridge/tunnels.h"

namespace pi_os_transport
{

/// Takes frames from the transport, finds their session, and passes each to the part of the bridge that handles its
/// type. Refuses what does not fit.
class FrameDispatcher : public FrameTransport::Listener
{
public:
  FrameDispatcher(BridgeContext* context, Sessions* sessions, IncomingLinks* incoming, OutgoingLinks* outgoing,
                  Tunnels* tunnels)
    : context_(context), sessions_(sessions), incoming_(incoming), outgoing_(outgoing), tunnels_(tunnels)
  {
  }

  // FrameTransport::Listener
  void onConnected(FrameTransport::ConnectionId connection) override;
  void onWritable(FrameTransport::ConnectionId connection) override;
  void onClosed(FrameTransport::ConnectionId connection, CloseReason reason) override;
  bool onAccept(const std::string& address) override;
  Verdict onIdentity(const Endpoint& at, const std::string& identity) override;
  void onUntrusted(const Endpoint& at, const std::string& reason) override;
  uint8_t* onHeader(FrameTransport::SourceId source, const FrameHeader& header, uint32_t length) override;
  void onFrame(FrameTransport::SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) override;
  void onSourceClosed(FrameTransport::SourceId source, CloseReason reason, const std::string& detail) override;

private:
  uint8_t* fragmentPlace(FrameTransport::SourceId source, const FrameHeader& header, uint32_t length);
  void onHello(FrameTransport::SourceId source, const uint8_t* payload, uint32_t length);
  std::optional<Endpoint> endpointOf(FrameTransport::SourceId source, const Hello& hello);
  void awaitGraph(FrameTransport::SourceId source, const Endpoint& endpoint, const Hello& hello);
  void greet(FrameTransport::SourceId source, Session* session, const Hello& hello);
  bool dispatch(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);

  BridgeContext* const context_;
  Sessions* const sessions_;
  IncomingLinks* const incoming_;
  OutgoingLinks* const outgoing_;
  Tunnels* const tunnels_;
  std::map<FrameTransport::SourceId, std::vector<uint8_t>> payloads_;  ///< of frames that are not fragments
  /// Memory of the fragments that are being received. Outlives a stream that ends meanwhile.
  std::map<FrameTransport::SourceId, std::shared_ptr<uint8_t>> fragments_;
  /// Greetings of bridges on unknown devices, until the ROS master has told whether these belong to the graph.
  std::map<std::pair<FrameTransport::SourceId, Endpoint>, Hello> unknown_;
};

}  // namespace pi_os_transport
