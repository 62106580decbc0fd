#pragma once

#include <ros/serialization.h>
#include <ros/serialized_message.h>

#include <boost/shared_array.hpp>

#include <memory>
#include <utility>

#include "pi_os_transport/zero_copy/arena.h"
#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/serialization.h"
#include "pi_os_transport/zero_copy/statistics.h"

namespace pi_os_transport::zero_copy
{

/// A message to fill and publish. Its largest array, if of a plain type and of at least Arena::SMALLEST_ARRAY bytes, is
/// at its final place and is not copied. Give this array its final size at once, because growth moves it. resize() does
/// not initialise new elements. Write through data() or a matrix: assign() and insert() are slow. Other fields may be
/// set in any order.
///
/// One thread at a time. An unpublished loan frees its memory, also after the end of the publisher or of ROS. In a
/// child process after fork() it may only be destroyed.
template <typename M>
class Loan
{
public:
  /// An empty loan.
  Loan() = default;
  static Loan borrow()
  {
    Loan loan;
    loan.arena_ = std::make_shared<Arena>();
    loan.message_ = std::make_unique<Message<M>>(Allocator<void>(loan.arena_));
    return loan;
  }
  Loan(Loan&&) noexcept = default;
  Loan& operator=(Loan&& other) noexcept
  {
    message_ = std::move(other.message_);  // before its arena
    arena_ = std::move(other.arena_);
    return *this;
  }

  Message<M>* operator->() const { return message_.get(); }
  Message<M>& operator*() const { return *message_; }
  Message<M>* get() const { return message_.get(); }
  /// False if default constructed, published or moved from.
  explicit operator bool() const { return message_ != nullptr; }
  void reset()
  {
    message_.reset();
    arena_.reset();
  }

  /// The message as roscpp sends it; may share memory with the loan, which must not be written afterwards.
  /// @param counters  counts how it was serialised.
  ros::SerializedMessage serialise(TopicCounters* counters) const
  {
    const std::shared_ptr<MemoryBlock> block = arena_->largest();
    if (!block)
    {
      counters->countSent(TopicCounters::SMALL, false);
      return ros::serialization::serializeMessage(*message_);
    }
    try
    {
      ros::SerializedMessage serialised = serialiseAround(block);
      if (serialised.buf)
      {
        counters->countSent(TopicCounters::IN_PLACE, !block->isShared());
        return serialised;
      }
    }
    catch (const ros::serialization::StreamOverrunException&)
    {
      // The rest of the message does not fit around the array.
    }
    // The message first: inside publish(), the next array to be allocated in shared memory is its buffer.
    ros::SerializedMessage copy = ros::serialization::serializeMessage(*message_);
    counters->countSent(TopicCounters::NO_ROOM, false);
    return copy;
  }

private:
  ros::SerializedMessage serialiseAround(const std::shared_ptr<MemoryBlock>& block) const
  {
    const uint32_t length = ros::serialization::serializationLength(*message_);
    InPlaceStream stream(*block);
    stream.next(length);
    stream.next(*message_);
    ros::SerializedMessage serialised;
    if (uint8_t* const start = stream.start())
    {
      block->startAt(start);
      serialised.buf = boost::shared_array<uint8_t>(start, [owner = block](uint8_t*) {});
      serialised.num_bytes = size_t{length} + 4;
      serialised.message_start = start + 4;
    }
    return serialised;
  }

  std::shared_ptr<Arena> arena_;
  std::unique_ptr<Message<M>> message_;
};

}  // namespace pi_os_transport::zero_copy
