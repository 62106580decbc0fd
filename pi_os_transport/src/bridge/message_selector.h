#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "bridge/config/bridge_config.h"
#include "bridge/outgoing_link.h"
#include "event_loop/event_loop.h"

namespace pi_os_transport
{

/// Messages up to this size are sent in one frame [B].
constexpr uint32_t SMALL_MESSAGE = 16 << 10;

/// Counters of one stream.
struct StreamCounters
{
  uint64_t messages = 0;      ///< sent, each counted once
  uint64_t bytes = 0;         ///< of these messages before compression [B]
  uint64_t superseded = 0;    ///< not sent because a newer one replaced it (keep_latest, or after an interruption)
  uint64_t rate_limited = 0;  ///< not sent because of rate_limit_hz
  uint64_t lost = 0;          ///< unreadable, or under way when the session ended and their publisher was gone
  uint64_t uncompressed = 0;  ///< sent uncompressed because compression failed
};

/// Takes the next message of a stream from the rings of its links, with all links that it is for. Applies keep_latest
/// and the rate limit.
class MessageSelector
{
public:
  using OnLink = std::function<void(const std::shared_ptr<OutgoingLink>&)>;

  /// @param on_due        the rate limit allows a latched message that had to wait
  /// @param on_too_large  a message is larger than `max_message_bytes`; it is still in the link's ring
  MessageSelector(EventLoop* loop, const TopicOptions& options, uint32_t max_message_bytes, StreamCounters* counters,
                  std::function<void()> on_due, OnLink on_too_large);

  void add(const std::shared_ptr<OutgoingLink>& link) { links_.push_back(link); }
  void remove(const std::shared_ptr<OutgoingLink>& link);
  const std::vector<std::shared_ptr<OutgoingLink>>& links() const { return links_; }

  /// Null if no message may be sent now.
  OutgoingMessagePtr next();
  /// The peer keeps the message with this serial for further targets; 0: none.
  void setLastSerial(uint64_t serial) { last_serial_ = serial; }

private:
  struct Head
  {
    std::shared_ptr<OutgoingLink> link;
    Descriptor descriptor;
    uint32_t index;
    std::shared_ptr<MappedSegment> segment;  ///< null: cannot be read
  };
  std::vector<Head> heads();
  OutgoingMessagePtr takeStart(const Head& head);
  OutgoingMessagePtr take(const std::vector<Head>& heads, uint64_t serial);
  bool takeFrom(const Head& head, OutgoingMessage* message, bool* unreadable);
  bool skip(const std::vector<Head>& heads, uint64_t serial);
  bool mayLeaveNow(bool latched);
  void dropSuperseded();

  EventLoop* const loop_;
  const TopicOptions options_;
  const uint32_t max_message_bytes_;
  StreamCounters* const counters_;
  const std::function<void()> on_due_;
  const OnLink on_too_large_;
  std::vector<std::shared_ptr<OutgoingLink>> links_;
  uint64_t last_serial_ = 0;
  uint64_t skipped_serial_ = 0;  ///< of the last message that the rate limit dropped; 0: none
  SteadyTime next_allowed_;
  Timer rate_timer_;
};

}  // namespace pi_os_transport
