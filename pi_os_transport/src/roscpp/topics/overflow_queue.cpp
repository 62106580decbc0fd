#include "roscpp/topics/overflow_queue.h"

#include <utility>

#include "roscpp/runtime.h"
#include "roscpp/topics/pooled_message.h"

namespace pi_os_transport
{

bool OverflowQueue::push(const ros::SerializedMessage& message, uint64_t serial, uint32_t number, size_t max_queue,
                         const RingSender* ring)
{
  const bool full = max_queue > 0 && messages_.size() >= max_queue &&
                    (ring != nullptr ? ring->untakenBytes() : 0) + bytes_ + message.num_bytes > SOCKET_BYTES;
  if (full)
  {
    popFront();
  }
  messages_.push_back(Waiting{messageToQueue(message, messages_.size()), serial, number});
  bytes_ += message.num_bytes;
  return full;
}

void OverflowQueue::popFront()
{
  bytes_ -= messages_.front().message.num_bytes;
  messages_.pop_front();
}

void OverflowQueue::takeOver(OverflowQueue* other)
{
  messages_.swap(other->messages_);
  std::swap(bytes_, other->bytes_);
}

void OverflowQueue::clear()
{
  messages_.clear();
  bytes_ = 0;
}

bool OverflowQueue::flush(RingSender* ring, size_t max_queue)
{
  while (!messages_.empty())
  {
    const Waiting& waiting = messages_.front();
    const uint8_t* const buffer = poolBuffer(waiting.message);
    const RingSender::Push pushed =
        buffer == nullptr ? RingSender::Push::FULL
                          : ring->push(buffer, static_cast<uint32_t>(waiting.message.num_bytes - LENGTH_PREFIX),
                                       max_queue, waiting.number, waiting.serial);
    if (pushed != RingSender::Push::WRITTEN)
    {
      if (buffer != nullptr)
      {
        Runtime::instance().pool().release(buffer);
      }
      if (!std::exchange(waiting_announced_, true))
      {
        ring->tell(Packet::WAITING);
      }
      return pushed == RingSender::Push::FULL && !(buffer == nullptr && ring->idle());
    }
    popFront();
  }
  return true;
}

}  // namespace pi_os_transport
