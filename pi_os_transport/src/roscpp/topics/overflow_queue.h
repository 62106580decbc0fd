#pragma once

#include <ros/serialized_message.h>

#include <cstdint>
#include <deque>

#include "shm/ring_sender.h"

namespace pi_os_transport
{

/// What finds no place in the ring of a link through bridges, in order. Not thread safe.
class OverflowQueue
{
public:
  /// Adds the newest message. Beyond `max_queue` (0: no limit) the oldest goes. @return true if one went.
  bool push(const ros::SerializedMessage& message, uint64_t serial, size_t max_queue);

  /// Moves what has a place into the ring, and tells the bridge once that more waits.
  /// @param after_tcp  as in Descriptor.
  /// @return false if waiting for a place is in vain: the ring is broken, or the pool is full and nothing that this
  ///         link has sent is there to be given back.
  bool flush(RingSender* ring, size_t max_queue, uint32_t after_tcp);
  /// The bridge has told of space, or another one has come: the next flush() asks again.
  void forgetAnnouncement() { waiting_announced_ = false; }

  void clear() { messages_.clear(); }
  size_t size() const { return messages_.size(); }
  /// Hands all of them over, oldest first.
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
