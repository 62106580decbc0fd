#include "roscpp/topics/overflow_queue.h"

#include <utility>

#include "roscpp/runtime.h"
#include "roscpp/topics/pooled_message.h"

namespace pi_os_transport
{

bool OverflowQueue::push(const ros::SerializedMessage& message, uint64_t serial, size_t max_queue)
{
  const bool full = max_queue > 0 && messages_.size() >= max_queue;
  if (full)
  {
    messages_.pop_front();
  }
  messages_.push_back(Waiting{messageToQueue(message, messages_.size()), serial});
  return full;
}

bool OverflowQueue::flush(RingSender* ring, size_t max_queue, uint32_t after_tcp)
{
  while (!messages_.empty())
  {
    const Waiting& waiting = messages_.front();
    const uint8_t* const buffer = poolBuffer(waiting.message);
    const RingSender::Push pushed =
        buffer == nullptr ? RingSender::Push::FULL
                          : ring->push(buffer, static_cast<uint32_t>(waiting.message.num_bytes - LENGTH_PREFIX),
                                       max_queue, after_tcp, waiting.serial);
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
    messages_.pop_front();
  }
  return true;
}

}  // namespace pi_os_transport
