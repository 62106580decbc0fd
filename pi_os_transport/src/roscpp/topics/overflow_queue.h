#pragma once

#include <ros/serialized_message.h>

#include <cstdint>
#include <deque>

#include "shm/ring_sender.h"

namespace pi_os_transport
{

/// The messages that found no place in the ring of a link through bridges, in order. Not thread safe.
class OverflowQueue
{
public:
  /// Adds the newest message. Above `max_queue` (0: no limit) the oldest is dropped. @return true if one was dropped.
  bool push(const ros::SerializedMessage& message, uint64_t serial, size_t max_queue);

  /// Moves messages into the ring while it has places, and tells the bridge once that more wait.
  /// @param after_tcp  as in Descriptor.
  /// @return false if waiting is useless: the ring is broken, or the pool is full and this link holds nothing that
  /// could
  ///         be freed.
  bool flush(RingSender* ring, size_t max_queue, uint32_t after_tcp);
  /// The bridge reported space, or was replaced: the next flush() may tell again that messages wait.
  void forgetAnnouncement() { waiting_announced_ = false; }

  /// Takes all messages of another queue, before this one has any.
  void takeOver(OverflowQueue* other) { messages_.swap(other->messages_); }
  void clear() { messages_.clear(); }
  size_t size() const { return messages_.size(); }
  /// Removes all messages, oldest first.
  template <typename Take>
  void takeAll(Take take)
  {
    for (; !messages_.empty(); messages_.pop_front())
    {
      take(messages_.front().message);
    }
  }

private:
  struct Waiting
  {
    ros::SerializedMessage message;
    uint64_t serial;
  };
  std::deque<Waiting> messages_;
  bool waiting_announced_ = false;
};

}  // namespace pi_os_transport
