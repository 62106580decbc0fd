#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "shm/ring_receiver.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

class OutgoingStream;

/// The link of a publisher on this device to one subscriber on the peer's device. To the publisher, this bridge is the
/// subscriber: the bridge reads the ring.
class OutgoingLink : public std::enable_shared_from_this<OutgoingLink>
{
public:
  enum class State
  {
    OPENING,  ///< the publisher has not offered its memory yet
    OFFERED,  ///< the peer offers memory to the subscriber
    CARRYING,
    CLOSING,  ///< messages that were taken are still under way
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
  bool publisher_gone = false;  ///< the rest of the ring is still delivered
  size_t max_queue = 0;
  uint32_t unacked = 0;                ///< messages sent and not acknowledged
  std::vector<uint32_t> undelivered;  ///< places of messages that were acknowledged while the subscriber took none
  LinkEnd end_reason = LinkEnd::BACK_TO_TCP;
  std::string end_text;

  /// The publisher has more messages than the ring can hold.
  void onPublisherWaits()
  {
    publisher_waits_ = true;
    announceSpace();
  }
  /// The message of this place has arrived. The publisher keeps it as long as it may wait in the other bridge.
  void onArrived(uint32_t place)
  {
    if (paused)
    {
      undelivered.push_back(place);
      return;
    }
    ring->release(place);
    onProgress();
  }
  /// The subscriber has taken everything.
  void onResumed()
  {
    for (const uint32_t place : std::exchange(undelivered, {}))
    {
      ring->release(place);
    }
    onProgress();
  }
  /// A message was taken or released.
  void onProgress()
  {
    progressed_ = true;
    announceSpace();
  }
  /// True if no message is under way, and none will follow.
  bool isDone() const
  {
    return unacked == 0 && (state == State::CLOSING || (publisher_gone && ring->ring().available() == 0));
  }

private:
  void announceSpace()
  {
    if (publisher_waits_ && progressed_ && ring->hasRing() && ring->ring().available() < RingLayout::CAPACITY / 2)
    {
      publisher_waits_ = false;
      progressed_ = false;
      ring->tell(Packet::SPACE);
    }
  }

  bool publisher_waits_ = false;
  bool progressed_ = true;  ///< since the publisher was last told of free places
};

/// A message, or the start of a link, for the peer.
struct OutgoingMessage
{
  struct Target
  {
    std::shared_ptr<OutgoingLink> link;
    LinkEntry entry;
    int place = -1;  ///< in the link's ring; -1: released
  };
  std::vector<Target> targets;
  bool start = false;   ///< starts the link of its only target; no message
  bool attach = false;  ///< the peer has the message already: only adds targets
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
using OutgoingMessagePtr = std::shared_ptr<OutgoingMessage>;

}  // namespace pi_os_transport
