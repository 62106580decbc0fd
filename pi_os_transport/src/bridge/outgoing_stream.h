#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bridge/config/bridge_config.h"
#include "bridge/message_selector.h"
#include "bridge/outgoing_link.h"
#include "bridge/peer.h"
#include "event_loop/event_loop.h"
#include "shm/ring_receiver.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

/// The messages of one publishing process and topic to one peer. Reads the rings of all subscribers on that device and
/// sends each message once, with the list of its links.
class OutgoingStream : public FrameSource, public std::enable_shared_from_this<OutgoingStream>
{
public:
  /// Compresses a message and calls `done` with the result, which is empty on failure.
  /// @return false if the codec is too busy; `done` is then not called.
  using Compressed = std::function<void(std::vector<uint8_t> bytes)>;
  using Compress = std::function<bool(const uint8_t* bytes, size_t length, Compressed done)>;

  /// @param compress  null if the topic is not compressed.
  OutgoingStream(uint32_t id, Peer* peer, EventLoop* loop, const TopicOptions& options, Compress compress,
                 std::string topic, std::string publisher, uint32_t max_message_bytes);

  Peer* peer() const { return peer_; }
  const std::string& topic() const { return topic_; }
  const std::string& publisher() const { return publisher_; }
  const StreamCounters& counters() const { return counters_; }
  const std::vector<std::shared_ptr<OutgoingLink>>& links() const { return selector_.links(); }

  void add(const std::shared_ptr<OutgoingLink>& link);
  /// Called when a link isDone().
  std::function<void(const std::shared_ptr<OutgoingLink>&)> on_link_done;
  void remove(const std::shared_ptr<OutgoingLink>& link) { selector_.remove(link); }
  /// Called when a message is larger than max_message_mb. The message is still in the link's ring.
  std::function<void(const std::shared_ptr<OutgoingLink>&)> on_too_large;

  bool sendNext(Peer* peer, Lane* lane) override;
  Traffic traffic() const override { return traffic_; }

  /// The session was interrupted: sends again what the peer has not acknowledged, limited to the publisher's queue
  /// size.
  void rewind();
  /// The session is over.
  void abandon();
  bool idle() const { return unacked_.empty() && resend_.empty() && !preparing_; }

private:
  bool prepare(const OutgoingMessagePtr& message);
  Traffic wantedTraffic(const OutgoingMessage& message) const;
  bool begin(Lane* lane, const OutgoingMessagePtr& message);
  bool fragment(Lane* lane, const OutgoingMessagePtr& message);
  bool transmit(Lane* lane, const FrameHeader& header, const iovec* payload, size_t pieces,
                const OutgoingMessagePtr& message, bool last);
  void onAcknowledged();
  void releasePlaces(OutgoingMessage* message);
  void finish(OutgoingMessage* message);
  void offerAgain();

  const uint32_t id_;
  Peer* const peer_;
  const TopicOptions options_;
  const Compress compress_;
  const std::string topic_;
  const std::string publisher_;
  Traffic traffic_;
  std::deque<OutgoingMessagePtr> unacked_;  ///< in the order of sending
  std::deque<OutgoingMessagePtr> resend_;
  OutgoingMessagePtr sending_;  ///< some fragments are not sent yet
  OutgoingMessagePtr waiting_;  ///< of the other traffic class: is sent when all before it are acknowledged
  bool preparing_ = false;      ///< a message is being compressed
  StreamCounters counters_;
  MessageSelector selector_;
};

}  // namespace pi_os_transport
