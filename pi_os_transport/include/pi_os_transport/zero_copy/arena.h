#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace pi_os_transport::zero_copy
{

/// Memory of one large array, with room around it for the rest of its message. It is in the shared pool of this process
/// while a topic of the process has a subscriber in shared memory, else on the heap. Freed when its last owner and all
/// subscribers have released it.
class MemoryBlock : public std::enable_shared_from_this<MemoryBlock>
{
public:
  /// @throws std::bad_alloc if there is no memory for `array_bytes`.
  explicit MemoryBlock(size_t array_bytes);
  ~MemoryBlock();
  MemoryBlock(const MemoryBlock&) = delete;
  MemoryBlock& operator=(const MemoryBlock&) = delete;

  /// Room before the array, for its message [B].
  static constexpr size_t HEADROOM = 1024 + 4;
  /// Least room behind the array [B].
  static constexpr size_t TAILROOM = 512;

  uint8_t* array() const { return memory_ + HEADROOM; }
  uint8_t* end() const { return memory_ + capacity_; }
  size_t arrayBytes() const { return array_bytes_; }
  bool isShared() const { return shared_; }

  /// Lets the message, with its length in front, start at `start`. From now on subscribers of this process can hold it.
  void startAt(uint8_t* start);

private:
  uint8_t* memory_ = nullptr;
  size_t capacity_ = 0;  // [B]
  const size_t array_bytes_;
  bool shared_ = false;
  const uint8_t* message_ = nullptr;  // known to subscribers in this process
};

/// The memory of the arrays of one loan. One thread at a time.
class Arena
{
public:
  /// Arrays from this size on are in the arena; smaller ones are on the heap and copied when sent [B].
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
