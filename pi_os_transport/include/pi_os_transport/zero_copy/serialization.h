#pragma once

// Serialisation of messages with arrays of zero_copy::Allocator: the same bytes as the standard messages, but an array
// at its final place is not copied, and a received array may become a view.

#include <ros/serialization.h>

#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include "pi_os_transport/zero_copy/allocator.h"
#include "pi_os_transport/zero_copy/message.h"

namespace pi_os_transport::zero_copy
{

/// While this object lives, arrays that this thread deserialises from [begin, begin + length) become views.
class ViewScope
{
public:
  ViewScope(const uint8_t* begin, size_t length);
  ~ViewScope();
  ViewScope(const ViewScope&) = delete;
  ViewScope& operator=(const ViewScope&) = delete;

  /// The scope of this thread; null if there is none.
  static ViewScope* current();

  bool contains(const uint8_t* data) const
  {
    return reinterpret_cast<uintptr_t>(data) - reinterpret_cast<uintptr_t>(begin_) < length_;
  }
  void countView() { ++views_; }
  void countMisaligned() { ++misaligned_; }
  uint32_t views() const { return views_; }
  /// Large arrays that had to be copied.
  uint32_t misaligned() const { return misaligned_; }

private:
  const uint8_t* const begin_;
  const size_t length_;
  ViewScope* const outer_;
  uint32_t views_ = 0;
  uint32_t misaligned_ = 0;
};

/// Writes a message around one of its arrays, which is not moved.
class InPlaceStream
{
public:
  static const ros::serialization::StreamType stream_type = ros::serialization::stream_types::Output;

  explicit InPlaceStream(const MemoryBlock& block) : block_(block), next_(head_), end_(head_ + sizeof(head_)) {}

  template <typename T>
  void next(const T& value)
  {
    ros::serialization::serialize(*this, value);
  }
  /// @throws ros::serialization::StreamOverrunException if the rest of the message does not fit.
  uint8_t* advance(uint32_t bytes)
  {
    if (static_cast<size_t>(end_ - next_) < bytes)
    {
      ros::serialization::throwStreamOverrun();
    }
    uint8_t* const place = next_;
    next_ += bytes;
    return place;
  }
  /// Skips `array` if it is the one at its final place. @return false if it has to be written.
  bool passOver(const void* array, size_t bytes)
  {
    if (array != block_.array())
    {
      return false;
    }
    const size_t head = static_cast<size_t>(next_ - head_);
    start_ = block_.array() - head;
    std::memcpy(start_, head_, head);
    next_ = block_.array() + bytes;
    end_ = block_.end();
    return true;
  }
  /// Start of the message; null if the array is not one of its fields.
  uint8_t* start() const { return start_; }

private:
  const MemoryBlock& block_;
  uint8_t head_[MemoryBlock::HEADROOM];  // not initialised: written up to next_
  uint8_t* next_;
  uint8_t* end_;
  uint8_t* start_ = nullptr;
};

/// True if an array of T in memory equals its serialisation.
template <typename T>
bool hasSerialisedLayout()
{
  if constexpr (ros::message_traits::IsSimple<T>::value)
  {
    return true;
  }
  else if constexpr (std::is_trivially_copyable_v<T> && ros::message_traits::IsFixedSize<T>::value)
  {
    static const bool same = ros::serialization::serializationLength(T()) == sizeof(T);  // no padding
    return same;
  }
  else
  {
    return false;
  }
}

/// Checks the length of an array before memory is allocated: a short message must not cause a large allocation.
/// @param each  least bytes of one element.
/// @throws ros::serialization::StreamOverrunException if the rest of the stream is too short.
template <typename Stream>
void checkCount(Stream& stream, uint32_t count, uint64_t each)
{
  if (count * each > stream.getLength())
  {
    ros::serialization::throwStreamOverrun();
  }
}

/// Least serialised size of an element [B].
template <typename T>
uint32_t shortestElement()
{
  constexpr uint32_t EMPTY_ARRAY = 4;  // an element of variable length holds a string or an array
  return ros::message_traits::IsFixedSize<T>::value ? ros::serialization::serializationLength(T()) : EMPTY_ARRAY;
}

/// Serialisation of arrays, whatever their elements.
template <typename T>
struct ArraySerialization
{
  using Array = std::vector<T, Allocator<T>>;

  template <typename Stream>
  static void write(Stream& stream, const Array& array)
  {
    stream.next(static_cast<uint32_t>(array.size()));
    if (array.empty())
    {
      return;
    }
    if (!hasSerialisedLayout<T>())
    {
      for (const T& element : array)
      {
        stream.next(element);
      }
      return;
    }
    const uint32_t bytes = static_cast<uint32_t>(array.size() * sizeof(T));
    if constexpr (std::is_same_v<Stream, InPlaceStream>)
    {
      if (stream.passOver(array.data(), bytes))
      {
        return;
      }
    }
    std::memcpy(stream.advance(bytes), static_cast<const void*>(array.data()), bytes);
  }

  template <typename Stream>
  static void read(Stream& stream, Array& array)
  {
    uint32_t count = 0;
    stream.next(count);
    if (!hasSerialisedLayout<T>())
    {
      checkCount(stream, count, shortestElement<T>());
      array.resize(count);
      for (T& element : array)
      {
        stream.next(element);
      }
      return;
    }
    checkCount(stream, count, sizeof(T));
    const uint64_t bytes = uint64_t{count} * sizeof(T);
    const uint8_t* const data = stream.advance(static_cast<uint32_t>(bytes));
    ViewScope* const scope = bytes >= Arena::SMALLEST_ARRAY ? ViewScope::current() : nullptr;
    if (scope != nullptr && scope->contains(data))
    {
      if (reinterpret_cast<uintptr_t>(data) % alignof(T) == 0)
      {
        array = Array(count, Allocator<T>::viewing(reinterpret_cast<const T*>(data), count));
        scope->countView();
        return;
      }
      scope->countMisaligned();
    }
    array.resize(count);
    if (count > 0)
    {
      std::memcpy(static_cast<void*>(array.data()), data, bytes);
    }
  }

  static uint32_t serializedLength(const Array& array)
  {
    uint32_t length = 4;
    if constexpr (ros::message_traits::IsFixedSize<T>::value)
    {
      length += array.empty()
                    ? 0
                    : ros::serialization::serializationLength(array.front()) * static_cast<uint32_t>(array.size());
    }
    else
    {
      for (const T& element : array)
      {
        length += ros::serialization::serializationLength(element);
      }
    }
    return length;
  }
};

}  // namespace pi_os_transport::zero_copy

namespace ros::serialization
{

template <typename T>
struct VectorSerializer<T, pi_os_transport::zero_copy::Allocator<T>, typename boost::enable_if<mt::IsSimple<T>>::type>
  : pi_os_transport::zero_copy::ArraySerialization<T>
{
};

template <typename T>
struct VectorSerializer<T, pi_os_transport::zero_copy::Allocator<T>,
                        typename boost::enable_if<mpl::and_<mt::IsFixedSize<T>, mpl::not_<mt::IsSimple<T>>>>::type>
  : pi_os_transport::zero_copy::ArraySerialization<T>
{
};

template <typename T>
struct VectorSerializer<T, pi_os_transport::zero_copy::Allocator<T>,
                        typename boost::disable_if<mt::IsFixedSize<T>>::type>
  : pi_os_transport::zero_copy::ArraySerialization<T>
{
};

}  // namespace ros::serialization
