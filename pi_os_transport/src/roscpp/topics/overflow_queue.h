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
  /// Adds the newest message. Above `max_queue` (0: no limit) the oldest is dropped, as soon as these messages and those
  /// in the ring exceed what the socket of TCPROS would hold. @return true if one was dropped.
  /// @param number  of the message on the link. @param ring  null: there is none now.
  bool push(const ros::SerializedMessage& message, uint64_t serial, uint32_t number, size_t max_queue,
            const RingSender* ring);

  /// Moves messages into the ring while it has places, and tells the bridge once that more wait.
  /// @return false if waiting is useless: the ring is broken, or the pool is full and this link holds nothing that
  ///         could be freed.
  bool flush(RingSender* ring, size_t max_queue);
  /// The bridge reported space, or was replaced: the next flush() may tell again that messages wait.
  void forgetAnnouncement() { waiting_announced_ = false; }

  /// Takes all messages of another queue, before this one has any.
  void takeOver(OverflowQueue* other);
  void clear();
  size_t size() const { return messages_.size(); }
  /// Removes all messages, oldest first: take(message, number).
  template <typename Take>
  void takeAll(Take take)
  {
    for (const Waiting& waiting : messages_)
    {
      take(waiting.message, waiting.number);
    }
    clear();
  }

private:
  struct Waiting
  {
    ros::SerializedMessage message;
    uint64_t serial;
    uint32_t number;
  };
  void popFront();

  std::deque<Waiting> messages_;
  uint64_t bytes_ = 0;  ///< of messages_
  bool waiting_announced_ = false;
};

}  // namespace pi_os_transport
