#pragma once

#include <functional>
#include <memory>

#include "bridge/bridge_request.h"
#include "bridge/local_pairs.h"
#include "bridge/sessions.h"

namespace pi_os_transport
{

/// The links of subscribers on this device to publishers on other devices: opens them, receives their messages into
/// shared memory, and ends them.
class IncomingLinks
{
public:
  /// @param on_ended  called after a link has ended
  IncomingLinks(BridgeContext* context, Sessions* sessions, LocalPairs* pairs, std::function<void()> on_ended);

  /// A node of this device wants a link.
  void open(const std::shared_ptr<ProcessPair>& pair, const BridgeRequest& request);
  /// The session is up: asks for the links that wait for it.
  void openWaiting(Session* session);
  /// LINK_READY, LINK_START, or LINK_CLOSE from the publisher's side.
  void onLinkFrame(Session* session, const FrameHeader& header);
  /// MESSAGE, BEGIN, FRAGMENT or ATTACH. @return false if the frame is not acceptable
  bool onStreamFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  /// The bridge ends: lets arrive what is under way, then ends all links of the session.
  void drain(Session* session);
  /// The session is lost.
  void abandon(Session* session, bool hung);

private:
  using LinkPtr = std::shared_ptr<IncomingLink>;

  void request(Session* session, const LinkPtr& link);
  void onSubscriber(Session* session, const LinkPtr& link, const Packet& packet);
  void offer(Session* session, const LinkPtr& link);
  void end(Session* session, const LinkPtr& ended, LinkEnd reason, bool tell_peer);
  void pauseBlocked();
  std::shared_ptr<IncomingStream> streamFor(Session* session, const FrameHeader& header);
  bool restore(const uint8_t* bytes, size_t size, const IncomingStream::Decompressed& done);
  void collect();
  void retireSegments();

  BridgeContext* const context_;
  Sessions* const sessions_;
  LocalPairs* const pairs_;
  const std::function<void()> on_ended_;
  Timer blocked_timer_;
};

}  // namespace pi_os_transport
