#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "shm/step_mark.h"

namespace pi_os_transport
{

/// The location of a serialised message, and its order.
struct Descriptor
{
  uint32_t segment = 0;    ///< id of the pool segment, unique in the publishing process; LINK_START: no message
  uint32_t length = 0;     ///< payload bytes [B], below 1 GiB
  uint64_t offset = 0;     ///< of the payload from the start of the segment [B], below 16 GiB
  uint32_t after_tcp = 0;  ///< number of messages (modulo 2^32) that the link carried over TCPROS before this one;
                           ///< behind a LINK_START instead the number of this message on the link, from 1
  uint64_t serial = 0;     ///< equal on all links for one publish(), else different; 0: unknown; below 2^56
  uint64_t stamp_ns = 0;   ///< when it was written into the ring, monotonic clock [ns]

  /// Segment of the first descriptor on a link through bridges: from here on TCPROS carries nothing. `length` is the
  /// publisher's queue size, and `serial` is 1 if the topic is latched.
  static constexpr uint32_t LINK_START = 0;
};

/// Memory shared by one publishing and one subscribing process for one link (docs/design/shared_memory_link.md).
/// Both map it writable. It has no locks: if a process dies between any two stores, the other one continues. All
/// indices count messages modulo 2^32; the place in the ring is index % CAPACITY. After taking a message, the
/// subscriber holds a ticket instead of the place. So a message held for long blocks no place, and its release is not
/// confused with that of a newer message.
struct RingLayout
{
  static constexpr uint32_t CAPACITY = 256;
  static constexpr uint64_t MAGIC = 0x34676e69724f5350;  // "PSOring4"

  uint64_t magic;                          ///< MAGIC, written by the publisher before the memory is handed over
  uint64_t nonce;                          ///< random; the subscriber sends it back to prove that it mapped this memory
  alignas(64) std::atomic<uint32_t> tail;  ///< next index to be written; publisher
  alignas(64) std::atomic<uint32_t> head;  ///< oldest index not taken; taken or dropped by compare-exchange
  std::atomic<uint32_t> armed;             ///< Doorbell of the sleeping subscriber; 0: it is awake
  alignas(64) std::atomic<uint32_t> release_count;      ///< releases so far; subscriber
  alignas(64) std::atomic<uint8_t> released[CAPACITY];  ///< 1: the message of this ticket is no longer read; subscriber
  struct Entry
  {
    std::atomic<uint64_t> segment_length;  ///< segment, low two bits of the offset, length: 32, 2, 30 bits
    std::atomic<uint64_t> offset_after;    ///< offset / 4, after_tcp: 32, 32 bits
    std::atomic<uint64_t> serial_ticket;   ///< serial, ticket: 56, 8 bits
    std::atomic<uint64_t> stamp_ns;
  };
  alignas(64) Entry entries[CAPACITY];
};
static_assert(std::atomic<uint64_t>::is_always_lock_free && std::atomic<uint8_t>::is_always_lock_free);

/// The publishing end. The caller serialises all calls.
class RingProducer
{
public:
  /// @param layout zeroed shared memory; initialised here. Must outlive this object.
  RingProducer(RingLayout* layout, uint64_t nonce);

  enum class Push
  {
    WRITTEN,
    FULL,  ///< not written: CAPACITY messages wait or are being read
  };
  /// @param doorbell  set to the doorbell to ring now; 0 if the subscriber is awake.
  Push push(const Descriptor& descriptor, uint32_t* doorbell);

  /// Messages that are neither taken nor dropped; CAPACITY + 1 if the peer wrote invalid indices.
  uint32_t inFlight();

  /// Takes back the oldest message that the subscriber has not taken.
  /// @return its ticket; -1 if there is none, or the peer wrote invalid indices.
  int dropOldest();

  /// Calls `done(ticket)` once for every message that the subscriber has released.
  template <typename Done>
  void collect(Done done)
  {
    const uint32_t releases = layout_->release_count.load(std::memory_order_acquire);
    if (releases == seen_releases_)
    {
      return;
    }
    seen_releases_ = releases;
    const uint32_t head = layout_->head.load(std::memory_order_acquire);
    least_head_ = head - least_head_ <= tail_ - least_head_ ? head : least_head_;
    forEachHeld(
        [&](uint32_t ticket)
        {
          // Ignore the release of a message that was never taken.
          if (layout_->released[ticket].load(std::memory_order_acquire) != 0 &&
              static_cast<int32_t>(head - owners_[ticket]) > 0)
          {
            PI_OS_STEP("collect.seen");
            layout_->released[ticket].store(0, std::memory_order_relaxed);
            PI_OS_STEP("collect.mark");
            vacate(ticket);
            done(ticket);
          }
        });
  }

  /// The peer is gone: calls `done(ticket)` for every message that is not collected.
  template <typename Done>
  void abandon(Done done)
  {
    forEachHeld(
        [&](uint32_t ticket)
        {
          vacate(ticket);
          done(ticket);
        });
  }

  /// The ticket of the next message; -1: none is free.
  int nextTicket() const;
  /// True if every message written has been dropped or collected.
  bool idle() const { return held_ == Tickets{}; }
  /// The ticket of the message with number `index` (of all pushed ones, from 0, modulo 2^32).
  /// @return -1 if it is dropped, collected or older than CAPACITY messages.
  int ticketOf(uint32_t index) const;

private:
  using Tickets = std::array<uint64_t, RingLayout::CAPACITY / 64>;  // one bit each

  template <typename Visit>
  void forEachHeld(Visit visit) const
  {
    for (size_t word = 0; word < held_.size(); ++word)
    {
      for (uint64_t bits = held_[word]; bits != 0; bits &= bits - 1)
      {
        visit(static_cast<uint32_t>(word * 64 + static_cast<size_t>(__builtin_ctzll(bits))));
      }
    }
  }
  bool isHeld(uint32_t ticket) const { return (held_[ticket / 64] >> (ticket % 64) & 1) != 0; }
  void vacate(uint32_t ticket) { held_[ticket / 64] &= ~(uint64_t{1} << (ticket % 64)); }

  RingLayout* layout_;
  uint32_t tail_ = 0;
  uint32_t least_head_ = 0;                  // lower bound of the head
  uint32_t seen_releases_ = 0;               // release_count at the last collect()
  Tickets held_{};                           // neither dropped nor collected
  uint32_t owners_[RingLayout::CAPACITY]{};  // by ticket: index of the message
  uint8_t tickets_[RingLayout::CAPACITY]{};  // by place: ticket of the message written there last
};

/// The subscribing end. The caller serialises all calls but release().
class RingConsumer
{
public:
  explicit RingConsumer(RingLayout* layout) : layout_(layout) {}

  enum class Take
  {
    TAKEN,    ///< `descriptor` and `ticket` are set; the memory stays valid until release(ticket)
    WAITING,  ///< the oldest message must wait for one over TCPROS; the doorbell is not armed
    EMPTY,    ///< no message; the doorbell is armed, unless broken()
  };
  /// Selects the Doorbell; NETWORK_THREAD at first. Takes effect with the next take().
  void useDoorbell(uint32_t doorbell) { doorbell_ = doorbell; }

  /// @param tcp_delivered messages (modulo 2^32) that this link has delivered from TCPROS.
  /// @param in_any_order  never wait, because no more messages come over TCPROS.
  Take take(uint32_t tcp_delivered, bool in_any_order, Descriptor* descriptor, uint32_t* ticket);

  /// Reads the oldest descriptor without taking it; the publisher may still drop the message.
  /// @return false if there is none; the doorbell is then armed.
  bool peek(Descriptor* descriptor, uint32_t* index);
  /// Takes the message of the last peek(). @return its ticket; -1 if the publisher has dropped it.
  int takePeeked(uint32_t index);

  /// Messages that wait to be taken.
  uint32_t available() const;

  /// True once the publisher wrote invalid indices: nothing more is taken.
  bool broken() const { return broken_; }

  /// Any thread.
  void release(uint32_t ticket);

private:
  RingLayout* layout_;
  uint32_t doorbell_ = 1;
  uint32_t peeked_ticket_ = 0;
  bool broken_ = false;
};

}  // namespace pi_os_transport
