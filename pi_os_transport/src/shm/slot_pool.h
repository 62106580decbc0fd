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
/// The memory is anonymous (memfd): it has no name in any file system, is not bounded by the size of /dev/shm, and the
/// kernel frees it with its last user. Pages are allocated when a segment is made, so that running out of memory is an
/// error here and never SIGBUS in a reader; segments are sealed against resizing and against new writable mappings.
/// All bookkeeping belongs to the owner. The pool grows by whole segments up to its limit and reuses idle ones.
///
/// All methods may be called from any thread. In a forked child nothing is allocated and releases do nothing.
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

  /// Reserves address space only. @param limit_bytes most memory that all segments may take together, >= 64 kiB.
  explicit SlotPool(uint64_t limit_bytes);
  ~SlotPool();
  SlotPool(const SlotPool&) = delete;
  SlotPool& operator=(const SlotPool&) = delete;

  /// Returns memory for `bytes` with one reference, or nullptr when the limit or the system's memory does not allow it
  /// (`lastError()` then says why). Not initialised. The address is a multiple of 64, less 4: what follows a four-byte
  /// length at its start is aligned.
  uint8_t* allocate(size_t bytes);

  /// Bytes at `payload`, at least as many as were asked for [B].
  uint64_t capacity(const uint8_t* payload) const;
  /// Lets a message start further back in the memory that allocate() returned: `message` then stands for `payload` in
  /// all calls. Overwrites up to 123 bytes before it, but none before `payload`.
  /// @param message  at any address from `payload` on.
  void place(uint8_t* payload, uint8_t* message);

  void addReference(const uint8_t* payload);
  /// Gives one reference back; the last one frees the slot.
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

  /// Gives the memory of all idle segments back to the system.
  void trim();

  /// Called, without any lock held, when a slot is wanted and none is free: collects what subscribers have released.
  void setReclaim(std::function<void()> reclaim) { reclaim_ = std::move(reclaim); }
  /// The segments given back to the system since the last call: peers that mapped them should let go as well.
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
