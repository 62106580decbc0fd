#pragma once

#include <functional>
#include <memory>
#include <string>

#include "bridge/local_pairs.h"
#include "bridge/sessions.h"

namespace pi_os_transport
{

/// The links of publishers on this device to subscribers on other devices: fetches them from the publishers, feeds
/// their streams, and ends them.
class OutgoingLinks
{
public:
  /// @param on_ended  called after a link has ended
  OutgoingLinks(BridgeContext* context, LocalPairs* pairs, std::function<void()> on_ended)
    : context_(context), pairs_(pairs), on_ended_(std::move(on_ended))
  {
  }

  /// LINK_OPEN, LINK_PROVED, LINK_PAUSE, LINK_RESUME, or LINK_CLOSE from the subscriber's side.
  /// @return false if the frame is not acceptable
  bool onLinkFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length);
  /// The bridge ends: ends all links of the session when what is under way has arrived.
  void drain(Session* session);
  /// The session is lost.
  void abandon(Session* session);

private:
  using LinkPtr = std::shared_ptr<OutgoingLink>;

  void open(Session* session, uint32_t id, const LinkOpen& open);
  /// @return why the link cannot be; empty if it was made
  std::string fetch(Session* session, uint32_t id, const LinkOpen& open);
  std::shared_ptr<OutgoingStream> streamFor(Session* session, const LinkOpen& open);
  OutgoingStream::Compress compressionFor(const TopicOptions& options, const LinkOpen& open);
  void onPublisher(Session* session, const LinkPtr& link, const Packet& packet, SideChannel::Descriptors* descriptors);
  void onPublisherEnd(Session* session, const LinkPtr& link, LinkEnd reason);
  void onNews(const LinkPtr& link);
  void end(Session* session, const LinkPtr& link, LinkEnd reason, const std::string& text);
  void close(Session* session, const LinkPtr& link);
  void forget(Session* session, const LinkPtr& link);

  BridgeContext* const context_;
  LocalPairs* const pairs_;
  const std::function<void()> on_ended_;
};

}  // namespace pi_os_transport
