#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "bridge/bridge_request.h"
#include "shm/ring_sender.h"
#include "shm/slot_pool.h"
#include "wire/frame_transport.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

/// A message in the shared memory of this bridge. Freed with its last user.
class PooledMessage
{
public:
  /// @return null if there is no memory.
  static std::shared_ptr<PooledMessage> make(SlotPool* pool, uint32_t length);
  ~PooledMessage() { pool_->release(buffer_); }
  PooledMessage(const PooledMessage&) = delete;
  PooledMessage& operator=(const PooledMessage&) = delete;

  const uint8_t* buffer() const { return buffer_; }  ///< starts with room for the length
  uint8_t* bytes() const { return buffer_ + LENGTH_PREFIX; }
  uint32_t length() const { return length_; }
  /// Adds a reference for a ring, which may outlive this object.
  void addReference() const { pool_->addReference(buffer_); }
  void dropReference() const { pool_->release(buffer_); }

private:
  PooledMessage(SlotPool* pool, uint8_t* buffer, uint32_t length) : pool_(pool), buffer_(buffer), length_(length) {}

  SlotPool* const pool_;
  uint8_t* const buffer_;
  const uint32_t length_;
};

/// The link of one subscriber on this device to a publisher on another one. To the subscriber, this bridge is the
/// publisher.
class IncomingLink
{
public:
  enum class State
  {
    WANTED,   ///< waits for the session
    OPENING,  ///< the peer was asked for the link
    OFFERED,  ///< the subscriber was offered shared memory
    CARRYING,
  };

  IncomingLink(uint32_t id, BridgeRequest request, std::shared_ptr<ProcessPair> pair)
    : id(id), request(std::move(request)), pair(std::move(pair))
  {
  }

  const uint32_t id;  ///< unique in this process
  const BridgeRequest request;
  State state = State::WANTED;
  const std::shared_ptr<ProcessPair> pair;  ///< with the subscriber's process
  std::shared_ptr<PairLink> end;            ///< this end of it
  std::unique_ptr<RingSender> ring;         ///< once offered

  /// Messages follow. @param max_queue  the publisher's queue size
  void start(size_t max_queue, uint32_t after_tcp);
  /// Passes a message to the subscriber, or keeps it if the subscriber accepts no more.
  void deliver(const LinkEntry& entry, const std::shared_ptr<PooledMessage>& message);
  /// Counts a message that was lost between the devices.
  void lose(const LinkEntry& entry);
  /// Passes on the kept messages. @return true if none is left
  bool flush();
  bool blocked() const { return !backlog_.empty() || decoder_busy; }

  uint64_t messages() const { return messages_; }
  uint64_t bytes() const { return bytes_; }
  uint64_t dropped() const { return dropped_ + (ring ? ring->dropped() : 0); }
  uint64_t lost() const { return lost_; }

  bool paused = false;        ///< the peer was told to send nothing
  bool decoder_busy = false;  ///< too many images wait for decompression
  /// Called when blocked() may have changed.
  std::function<void()> on_blocked;

private:
  struct Kept
  {
    LinkEntry entry;
    std::shared_ptr<PooledMessage> message;
  };
  bool isNew(const LinkEntry& entry);
  bool push(const LinkEntry& entry, const PooledMessage& message);
  void popKept();

  bool started_ = false;
  size_t max_queue_ = 0;
  uint32_t last_sequence_ = 0;
  std::deque<Kept> backlog_;
  uint64_t backlog_bytes_ = 0;
  uint64_t messages_ = 0;
  uint64_t bytes_ = 0;
  uint64_t dropped_ = 0;
  uint64_t lost_ = 0;
};

/// Assembles the messages that a peer sends on one stream, and passes each to its links.
class IncomingStream : public std::enable_shared_from_this<IncomingStream>
{
public:
  using FindLink = std::function<std::shared_ptr<IncomingLink>(uint32_t id)>;
  /// Decompresses an image and calls `done`, with no bytes on failure. @return false if the codec is too busy.
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
  /// Where the bytes of a FRAGMENT belong. Null if the frame is not acceptable.
  std::shared_ptr<uint8_t> fragmentMemory(const FrameHeader& header, uint32_t length);
  bool onFragment(const FrameHeader& header, uint32_t length);
  bool onAttach(const FrameHeader& header, const uint8_t* payload, uint32_t length);

  /// True while fragments of a message are missing.
  bool arriving() const { return arriving_ != nullptr; }

  /// The session was interrupted: an incomplete message is sent again, or never.
  void interrupt();

private:
  struct Arrival
  {
    std::vector<LinkEntry> entries;
    std::shared_ptr<PooledMessage> message;  ///< as received, then as delivered; null: no memory
    bool compressed = false;
    uint32_t length = 0;
    uint32_t received = 0;
    bool ready = false;  ///< complete, and decompressed if it was compressed
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
  ArrivalPtr arriving_;  ///< incomplete
  bool decoding_ = false;
  std::vector<std::weak_ptr<IncomingLink>> held_back_;
  std::deque<ArrivalPtr> undelivered_;  ///< complete; the first one is being decompressed
  ArrivalPtr last_;                     ///< the last one; further links may be attached
};

}  // namespace pi_os_transport
