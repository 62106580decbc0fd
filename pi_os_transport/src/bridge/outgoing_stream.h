#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bridge/bridge_config.h"
#include "event_loop/event_loop.h"
#include "bridge/peer.h"
#include "shm/ring_receiver.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

class OutgoingStream;

/// One subscriber on the peer's device, seen from the publisher's: this bridge stands for it before the publisher and
/// reads its ring.
class OutgoingLink : public std::enable_shared_from_this<OutgoingLink>
{
public:
  enum class State
  {
    OPENING,  ///< the publisher has not offered its memory yet
    OFFERED,  ///< the peer asks the subscriber
    CARRYING,
    CLOSING,  ///< what was taken is still under way
  };

  OutgoingLink(uint32_t id, std::shared_ptr<RingReceiver> ring) : id(id), ring(std::move(ring)) {}

  const uint32_t id;  ///< chosen by the peer
  const std::shared_ptr<RingReceiver> ring;
  State state = State::OPENING;
  std::weak_ptr<OutgoingStream> stream;
  std::string subscriber;
  uint32_t next_sequence = 1;
  uint32_t after_tcp = 0;
  bool started = false;
  bool paused = false;
  bool latched = false;
  bool publisher_gone = false;  ///< what is left in the ring still goes to the subscriber
  size_t max_queue = 0;
  uint32_t unacked = 0;  ///< messages sent and not acknowledged
  LinkEnd end_reason = LinkEnd::BACK_TO_TCP;
  std::string end_text;

  /// The publisher has more than finds a place in the ring.
  void onPublisherWaits();
  /// Something was taken or released.
  void onProgress();
  /// True if nothing is under way for it, and nothing will be.
  bool isDone() const
  {
    return unacked == 0 && (state == State::CLOSING || (publisher_gone && ring->ring().available() == 0));
  }

private:
  void announceSpace();

  bool publisher_waits_ = false;
  bool progressed_ = true;  ///< since the publisher was last told that there is place
};

/// What one publishing process sends on one topic to one peer: reads the rings of all subscribers there and sends each
/// message once, with the list of those that it is for.
class OutgoingStream : public FrameSource, public std::enable_shared_from_this<OutgoingStream>
{
public:
  struct Counters
  {
    uint64_t messages = 0;      ///< sent, each counted once
    uint64_t bytes = 0;         ///< of these messages before compression [B]
    uint64_t superseded = 0;    ///< not sent because a newer one was there (keep_latest, or after an interruption)
    uint64_t rate_limited = 0;  ///< not sent because of rate_limit_hz
    uint64_t lost = 0;          ///< taken from the publisher and not known to have arrived when the session ended
    uint64_t uncompressed = 0;  ///< sent as they are because they could not be compressed
  };

  /// Compresses a message of this topic and calls `done` with the result, empty if it cannot be.
  /// @return false if it is too busy; `done` is then never called.
  using Compressed = std::function<void(std::vector<uint8_t> bytes)>;
  using Compress = std::function<bool(const uint8_t* bytes, size_t length, Compressed done)>;

  /// @param compress  null if the topic is not compressed.
  OutgoingStream(uint32_t id, Peer* peer, EventLoop* loop, const TopicOptions& options, Compress compress,
                 std::string topic, std::string publisher, uint32_t max_message_bytes);
  ~OutgoingStream() override;

  uint32_t id() const { return id_; }
  Peer* peer() const { return peer_; }
  const std::string& topic() const { return topic_; }
  const std::string& publisher() const { return publisher_; }
  const Counters& counters() const { return counters_; }
  const std::vector<std::shared_ptr<OutgoingLink>>& links() const { return links_; }

  void add(const std::shared_ptr<OutgoingLink>& link);
  /// Called when the last message under way for a link has arrived and isDone() holds.
  std::function<void(const std::shared_ptr<OutgoingLink>&)> on_link_done;
  void remove(const std::shared_ptr<OutgoingLink>& link);
  /// A message was larger than max_message_mb; it is still in the link's ring.
  std::function<void(const std::shared_ptr<OutgoingLink>&)> on_too_large;

  bool sendNext(Peer* peer, Lane* lane) override;
  Traffic traffic() const override { return traffic_; }

  /// The session was interrupted: what the peer has not acknowledged will be sent again, as far as the publisher's
  /// queue size allows.
  void rewind();
  /// The session is over.
  void abandon();
  bool idle() const { return unacked_.empty() && resend_.empty() && !preparing_; }

private:
  /// A message, or the start of a link, on its way to the peer.
  struct Outgoing
  {
    struct Target
    {
      std::shared_ptr<OutgoingLink> link;
      LinkEntry entry;
      int place = -1;  ///< in the link's ring, to be released; -1: released
    };
    std::vector<Target> targets;
    bool start = false;   ///< of the only target, without a message
    bool attach = false;  ///< the peer has the message: it was the last one on this stream
    uint64_t serial = 0;
    std::shared_ptr<MappedSegment> segment;
    const uint8_t* data = nullptr;  ///< in the segment, or in copy
    uint32_t length = 0;            ///< [B]
    std::vector<uint8_t> copy;
    bool compressed = false;
    std::vector<uint8_t> head;  ///< payload before the message's bytes
    bool begun = false;
    uint32_t sent = 0;  ///< [B]
  };
  using OutgoingPtr = std::shared_ptr<Outgoing>;

  struct Head
  {
    std::shared_ptr<OutgoingLink> link;
    Descriptor descriptor;
    uint32_t index;
  };
  std::vector<Head> heads();
  OutgoingPtr next();
  OutgoingPtr takeStart(const Head& head);
  OutgoingPtr take(const std::vector<Head>& heads, uint64_t serial);
  bool skip(const std::vector<Head>& heads, uint64_t serial);
  bool mayLeaveNow(bool latched);
  void dropSuperseded();
  bool prepare(const OutgoingPtr& message);
  Traffic wantedTraffic(const Outgoing& message) const;
  bool begin(Lane* lane, const OutgoingPtr& message);
  bool fragment(Lane* lane, const OutgoingPtr& message);
  bool transmit(Lane* lane, const FrameHeader& header, const iovec* payload, size_t pieces, const OutgoingPtr& message,
                bool last);
  void onAcknowledged();
  void releasePlaces(Outgoing* message);
  void finish(Outgoing* message);
  void offerAgain();

  const uint32_t id_;
  Peer* const peer_;
  EventLoop* const loop_;
  const TopicOptions options_;
  const Compress compress_;
  const std::string topic_;
  const std::string publisher_;
  Traffic traffic_;
  std::vector<std::shared_ptr<OutgoingLink>> links_;
  std::deque<OutgoingPtr> unacked_;  ///< in the order of sending
  std::deque<OutgoingPtr> resend_;
  OutgoingPtr sending_;       ///< begun, with fragments to follow
  OutgoingPtr waiting_;       ///< taken, but of the other traffic class: goes when all before it is acknowledged
  bool preparing_ = false;    ///< a message is being compressed
  uint64_t last_serial_ = 0;  ///< of the message that the peer keeps for further links; 0: none
  uint32_t max_message_bytes_;
  uint64_t skipped_serial_ = 0;  ///< of the message that the rate limit withheld last; 0: none
  SteadyTime next_allowed_;
  EventLoop::TimerId rate_timer_ = 0;
  Counters counters_;
};

}  // namespace pi_os_transport
