#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace pi_os_transport::zero_copy
{

/// Memory of one large array, with room around it for the rest of its message. In the shared pool of this process while
/// any of its topics has a subscriber there, otherwise on the heap. Given back with its last owner; not before a
/// subscriber that was sent it has let go.
class MemoryBlock : public std::enable_shared_from_this<MemoryBlock>
{
public:
  /// Room for `array_bytes`. @throws std::bad_alloc if there is no memory of either kind.
  explicit MemoryBlock(size_t array_bytes);
  ~MemoryBlock();
  MemoryBlock(const MemoryBlock&) = delete;
  MemoryBlock& operator=(const MemoryBlock&) = delete;

  /// Bytes before the array, all of which its message may use [B].
  static constexpr size_t HEADROOM = 1024 + 4;
  /// Least bytes behind the array [B].
  static constexpr size_t TAILROOM = 512;

  uint8_t* array() const { return memory_ + HEADROOM; }
  uint8_t* end() const { return memory_ + capacity_; }
  size_t arrayBytes() const { return array_bytes_; }
  bool isShared() const { return shared_; }

  /// Lets the message, with its length in front, start at `start`. From now on this process can hold it.
  void startAt(uint8_t* start);

private:
  uint8_t* memory_ = nullptr;
  size_t capacity_ = 0;  // [B]
  const size_t array_bytes_;
  bool shared_ = false;
  const uint8_t* message_ = nullptr;  // as announced to subscribers in this process
};

/// Where the arrays of one message that is lent out lie. One thread at a time.
class Arena
{
public:
  /// Arrays from this size on lie here, smaller ones on the heap: they are copied when they are sent [B].
  static constexpr size_t SMALLEST_ARRAY = 1024;
  static constexpr size_t ALIGNMENT = 64;  ///< of every array [B]

  /// @throws std::bad_alloc
  void* allocate(size_t bytes);
  void deallocate(const void* array) noexcept;

  /// The largest array; null if there is none.
  std::shared_ptr<MemoryBlock> largest() const;

private:
  std::vector<std::shared_ptr<MemoryBlock>> blocks_;
};

}  // namespace pi_os_transport::zero_copy
