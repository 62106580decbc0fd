#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Memory for serialised messages that other processes can map read-only; owned by one publishing process.
///
/// The memory is anonymous (memfd): it has no file name, is not limited by /dev/shm, and is freed with its last user.
/// Pages are allocated with the segment, so a lack of memory is an error here and never SIGBUS in a reader. Segments
/// are sealed against resizing and new writable mappings. Only the owner keeps books. The pool grows by segments up to
/// its limit and reuses idle ones.
///
/// Thread safe. In a forked child nothing is allocated and releases do nothing.
class SlotPool
{
public:
  struct Location
  {
    uint32_t segment;  ///< segment id, never reused by this pool
    uint64_t offset;   ///< of the payload in the segment [B]
  };
  struct Segment
  {
    int fd;           ///< owned by the pool
    uint64_t length;  ///< [B]
  };
  struct Usage
  {
    uint64_t committed;  ///< bytes of all segments [B]
    uint64_t limit;      ///< [B]
    uint32_t segments;
    uint32_t live_slots;
  };

  /// Only reserves address space. @param limit_bytes  most memory of all segments, >= 64 kiB.
  explicit SlotPool(uint64_t limit_bytes);
  ~SlotPool();
  SlotPool(const SlotPool&) = delete;
  SlotPool& operator=(const SlotPool&) = delete;

  /// Returns memory for `bytes` with one reference, not initialised; nullptr if the limit or the system does not allow
  /// it (see `lastError()`). The address is a multiple of 64, less 4: data behind a four-byte length are aligned.
  uint8_t* allocate(size_t bytes);

  /// Usable size at `payload`, at least the requested size [B].
  uint64_t capacity(const uint8_t* payload) const;
  /// Moves the start of a message from `payload` to `message`, which replaces `payload` in all calls. Overwrites up to
  /// 123 bytes before `message`, but none before `payload`.
  /// @param message  any address from `payload` on.
  void place(uint8_t* payload, uint8_t* message);

  void addReference(const uint8_t* payload);
  /// Drops one reference; the last one frees the slot.
  void release(const uint8_t* payload);

  /// True if `payload` points into this pool. Lock-free.
  bool contains(const void* payload) const
  {
    return static_cast<uint64_t>(static_cast<const uint8_t*>(payload) - base_) < reserved_;
  }
  const uint8_t* base() const { return base_; }
  uint64_t reserved() const { return reserved_; }

  Location locate(const uint8_t* payload) const;
  Segment segment(uint32_t id) const;

  /// Returns the memory of all idle segments to the system.
  void trim();

  /// Sets a function that collects what subscribers have released. Called without locks when no slot is free.
  void setReclaim(std::function<void()> reclaim) { reclaim_ = std::move(reclaim); }
  /// The segments freed since the last call: peers should unmap them.
  std::vector<uint32_t> takeRetired();

  Usage usage() const;
  std::string lastError() const;

private:
  struct Slot;  // header in front of each payload
  struct SegmentRecord
  {
    uint32_t id;
    uint8_t* start;
    uint64_t length;
    uint64_t carved = 0;  // bytes handed out as slots so far; the rest has never been used
    uint32_t live = 0;    // slots with references
    uint32_t slots = 0;
    FileDescriptor fd;
  };

  static uint64_t roundToClass(uint64_t total, uint32_t* size_class);
  uint8_t* popFree(uint32_t size_class, uint64_t total);
  uint8_t* carve(uint64_t capacity, uint32_t size_class);
  bool grow(uint64_t capacity);
  bool makeSegment(uint64_t length);
  bool recycleIdle(uint64_t capacity);
  void forgetSlots(const SegmentRecord& record);
  void destroy(size_t index);
  void trimLocked();
  uint8_t* findAddress(uint64_t length) const;
  SegmentRecord* recordOf(uint32_t id);
  const SegmentRecord* recordOf(uint32_t id) const;

  static constexpr uint32_t CLASSES = 200;

  const uint64_t limit_;
  uint8_t* base_ = nullptr;
  uint64_t reserved_ = 0;
  mutable std::mutex mutex_;
  std::vector<SegmentRecord> segments_;  // by rising start address
  Slot* free_[CLASSES] = {};
  uint32_t class_slots_[CLASSES] = {};
  uint64_t committed_ = 0;
  uint32_t next_segment_ = 1;
  std::string last_error_;
  std::function<void()> reclaim_;
  std::vector<uint32_t> retired_;
  std::atomic<bool> any_retired_{false};
};

}  // namespace pi_os_transport
