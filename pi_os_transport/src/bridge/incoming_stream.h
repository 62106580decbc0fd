#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "wire/frame_transport.h"
#include "bridge/bridge_request.h"
#include "shm/ring_sender.h"
#include "shm/slot_pool.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

/// A message in the shared memory of this bridge; freed with its last user.
class PooledMessage
{
public:
  /// @return null if there is no memory.
  static std::shared_ptr<PooledMessage> make(SlotPool* pool, uint32_t length);
  ~PooledMessage() { pool_->release(buffer_); }
  PooledMessage(const PooledMessage&) = delete;
  PooledMessage& operator=(const PooledMessage&) = delete;

  const uint8_t* buffer() const { return buffer_; }  ///< with room for the length in front
  uint8_t* bytes() const { return buffer_ + LENGTH_PREFIX; }
  uint32_t length() const { return length_; }
  /// A reference that outlives this object, for a ring.
  void addReference() const { pool_->addReference(buffer_); }
  void dropReference() const { pool_->release(buffer_); }

private:
  PooledMessage(SlotPool* pool, uint8_t* buffer, uint32_t length) : pool_(pool), buffer_(buffer), length_(length) {}

  SlotPool* const pool_;
  uint8_t* const buffer_;
  const uint32_t length_;
};

/// One subscriber on this device and its link to a publisher on another one. It sees this bridge in the publisher's
/// place.
class IncomingLink
{
public:
  enum class State
  {
    WANTED,   ///< the peer is not up
    OPENING,  ///< the peer was asked
    OFFERED,  ///< the subscriber was offered shared memory
    CARRYING,
  };

  IncomingLink(uint32_t id, BridgeRequest request, SideChannel client)
    : id(id), request(std::move(request)), client(std::move(client))
  {
  }

  const uint32_t id;  ///< unique in this process
  const BridgeRequest request;
  State state = State::WANTED;
  SideChannel client;                ///< until the ring takes it over
  std::unique_ptr<RingSender> ring;  ///< once offered

  int fd() const { return ring ? ring->channel().fd() : client.fd(); }
  SideChannel& channel() { return ring ? ring->channel() : client; }

  /// The publisher's queue size is known and messages follow.
  void start(size_t max_queue, uint32_t after_tcp);
  /// Hands a message on, or keeps it if the subscriber does not take more.
  void deliver(const LinkEntry& entry, const std::shared_ptr<PooledMessage>& message);
  /// A message for this link was lost on the way.
  void lose(const LinkEntry& entry);
  /// Hands on what was kept. @return true if nothing is kept any more.
  bool flush();
  bool blocked() const { return !backlog_.empty() || decoder_busy; }

  uint64_t messages() const { return messages_; }
  uint64_t bytes() const { return bytes_; }
  uint64_t dropped() const { return dropped_ + (ring ? ring->dropped() : 0); }
  uint64_t lost() const { return lost_; }

  bool paused = false;        ///< the peer was told to send nothing
  bool decoder_busy = false;  ///< images wait to be restored
  /// Called when blocked() has changed.
  std::function<void()> on_blocked;

private:
  struct Kept
  {
    LinkEntry entry;
    std::shared_ptr<PooledMessage> message;
  };
  bool isNew(const LinkEntry& entry);
  bool push(const LinkEntry& entry, const PooledMessage& message);

  bool started_ = false;
  size_t max_queue_ = 0;
  uint32_t last_sequence_ = 0;
  std::deque<Kept> backlog_;
  uint64_t messages_ = 0;
  uint64_t bytes_ = 0;
  uint64_t dropped_ = 0;
  uint64_t lost_ = 0;
};

/// Puts together what a peer sends on one stream, and hands it to the links that it is for.
class IncomingStream : public std::enable_shared_from_this<IncomingStream>
{
public:
  using FindLink = std::function<std::shared_ptr<IncomingLink>(uint32_t id)>;
  /// Decompresses an image and calls `done`; empty if it cannot be. @return false if it is too busy.
  using Decompressed = std::function<void(std::vector<uint8_t> bytes)>;
  using Decompress = std::function<bool(const uint8_t* bytes, size_t length, Decompressed done)>;

  IncomingStream(SlotPool* pool, uint32_t max_message_bytes, FindLink find_link, Decompress decompress)
    : pool_(pool)
    , max_message_bytes_(max_message_bytes)
    , find_link_(std::move(find_link))
    , decompress_(std::move(decompress))
  {
  }

  // Each returns false if the frame is not acceptable.
  bool onMessage(const FrameHeader& header, const uint8_t* payload, uint32_t length);
  bool onBegin(const FrameHeader& header, const uint8_t* payload, uint32_t length);
  /// Where the bytes of a FRAGMENT go, valid as long as it is kept; null if it is not acceptable.
  std::shared_ptr<uint8_t> fragmentMemory(const FrameHeader& header, uint32_t length);
  bool onFragment(const FrameHeader& header, uint32_t length);
  bool onAttach(const FrameHeader& header, const uint8_t* payload, uint32_t length);

  /// True while the rest of a message is on its way.
  bool arriving() const { return arriving_ != nullptr; }

  /// The rest of a message begun will not come, or come again from the start.
  void interrupt();

private:
  struct Arrival
  {
    std::vector<LinkEntry> entries;
    std::shared_ptr<PooledMessage> message;  ///< as it comes, then as it is delivered; null: no memory for it
    bool compressed = false;
    uint32_t length = 0;
    uint32_t received = 0;
    bool ready = false;  ///< whole and, if it came compressed, restored
  };
  using ArrivalPtr = std::shared_ptr<Arrival>;

  void decodeNext();
  void holdBack(bool busy);
  bool isNext(const FrameHeader& header, uint32_t length) const;
  bool readEntries(const FrameHeader& header, PayloadReader* in, std::vector<LinkEntry>* entries) const;
  ArrivalPtr makeArrival(const FrameHeader& header, uint32_t length) const;
  void complete(const ArrivalPtr& arrival);
  void deliverReady();
  void deliver(const Arrival& arrival, const std::vector<LinkEntry>& entries);

  SlotPool* const pool_;
  const uint32_t max_message_bytes_;
  const FindLink find_link_;
  const Decompress decompress_;
  ArrivalPtr arriving_;  ///< begun, not complete
  bool decoding_ = false;
  std::vector<std::weak_ptr<IncomingLink>> held_back_;
  std::deque<ArrivalPtr> undelivered_;  ///< complete; the front one is being decompressed
  ArrivalPtr last_;                     ///< begun last; further links may be attached to it
};

}  // namespace pi_os_transport
