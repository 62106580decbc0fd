#pragma once

#include <cstddef>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <type_traits>
#include <utility>

#include "pi_os_transport/zero_copy/arena.h"

namespace pi_os_transport::zero_copy
{

/// The allocator parameter of zero-copy messages. It has three modes:
/// - arena, in a loan for publishing: large arrays are in the arena, from where they are sent;
/// - view, for a received array: the array uses the memory in which it was received;
/// - heap, for everything else: copies of messages, and arrays that outgrow their view.
///
/// resize() does not initialise arrays of a trivially copyable type from Arena::SMALLEST_ARRAY bytes on.
/// Strings use the standard allocator, so their type is std::string.
template <typename T>
class Allocator
{
public:
  using value_type = T;
  using propagate_on_container_move_assignment = std::true_type;
  using propagate_on_container_swap = std::true_type;
  using propagate_on_container_copy_assignment = std::false_type;
  using is_always_equal = std::false_type;
  template <typename Other>
  struct rebind
  {
    using other = std::conditional_t<std::is_same_v<Other, char>, std::allocator<Other>, Allocator<Other>>;
  };

  Allocator() noexcept = default;
  template <typename Other>
  Allocator(const Allocator<Other>& other) noexcept : arena_(other.arena())
  {
  }
  /// For one read-only array of exactly `count` elements at `memory`.
  static Allocator viewing(const T* memory, size_t count)
  {
    Allocator allocator;
    allocator.view_ = const_cast<T*>(memory);
    allocator.count_ = count;
    return allocator;
  }
  Allocator select_on_container_copy_construction() const { return Allocator(); }

  T* allocate(size_t count)
  {
    if (view_ != nullptr && count == count_)
    {
      return view_;
    }
    if (count > std::numeric_limits<size_t>::max() / sizeof(T))
    {
      throw std::bad_alloc();
    }
    if (inArena(count))
    {
      return static_cast<T*>(arena_->allocate(count * sizeof(T)));
    }
    T* const memory = std::allocator<T>().allocate(count);
    if constexpr (std::is_trivially_copyable_v<T>)
    {
      if (count * sizeof(T) < Arena::SMALLEST_ARRAY)
      {
        std::memset(static_cast<void*>(memory), 0,
                    count * sizeof(T));  // construct() initialises nothing; zeroing small arrays is cheap
      }
    }
    return memory;
  }
  void deallocate(T* memory, size_t count) noexcept
  {
    if (memory == view_)
    {
      return;
    }
    if (inArena(count))
    {
      arena_->deallocate(memory);
      return;
    }
    std::allocator<T>().deallocate(memory, count);
  }

  template <typename Element, typename... Arguments>
  void construct(Element* element, Arguments&&... arguments)
  {
    if constexpr (sizeof...(Arguments) > 0)
    {
      ::new (static_cast<void*>(element)) Element(std::forward<Arguments>(arguments)...);
    }
    else if constexpr (!std::is_trivially_copyable_v<Element>)
    {
      ::new (static_cast<void*>(element)) Element();
    }
  }

  const std::shared_ptr<Arena>& arena() const { return arena_; }
  /// True if the array uses received memory.
  bool isView(const T* memory) const { return memory == view_ && memory != nullptr; }

  template <typename Other>
  bool operator==(const Allocator<Other>& other) const
  {
    return arena_ == other.arena() && view() == other.view();
  }
  template <typename Other>
  bool operator!=(const Allocator<Other>& other) const
  {
    return !(*this == other);
  }
  const void* view() const { return view_; }

private:
  bool inArena(size_t count) const
  {
    return std::is_trivially_copyable_v<T> && alignof(T) <= Arena::ALIGNMENT && arena_ != nullptr &&
           count * sizeof(T) >= Arena::SMALLEST_ARRAY;
  }

  std::shared_ptr<Arena> arena_;
  T* view_ = nullptr;
  size_t count_ = 0;
};

/// The template argument of generated messages.
template <>
class Allocator<void>
{
public:
  using value_type = void;
  template <typename Other>
  struct rebind
  {
    using other = std::conditional_t<std::is_same_v<Other, char>, std::allocator<Other>, Allocator<Other>>;
  };

  Allocator() noexcept = default;
  explicit Allocator(std::shared_ptr<Arena> arena) noexcept : arena_(std::move(arena)) {}
  /// Strings use the standard allocator.
  template <typename Other>
  operator std::allocator<Other>() const
  {
    return std::allocator<Other>();
  }

  const std::shared_ptr<Arena>& arena() const { return arena_; }

private:
  std::shared_ptr<Arena> arena_;
};

}  // namespace pi_os_transport::zero_copy
