#include "roscpp/topics/pooled_message.h"

#include <cstring>

#include "roscpp/runtime.h"

namespace pi_os_transport
{

const uint8_t* poolBuffer(const ros::SerializedMessage& message)
{
  SlotPool& pool = Runtime::instance().pool();
  if (message.num_bytes < LENGTH_PREFIX)
  {
    return nullptr;
  }
  if (pool.contains(message.buf.get()))
  {
    pool.addReference(message.buf.get());
    return message.buf.get();
  }
  // Latched messages, messages for a single subscriber, and messages serialised while the pool was full.
  uint8_t* const copy = pool.allocate(message.num_bytes);
  if (copy != nullptr)
  {
    std::memcpy(copy, message.buf.get(), message.num_bytes);
  }
  return copy;
}

ros::SerializedMessage messageToQueue(const ros::SerializedMessage& message, size_t waiting)
{
  if (waiting < MAX_POOLED_WAITING || !Runtime::instance().pool().contains(message.buf.get()))
  {
    return message;
  }
  ros::SerializedMessage copy;
  copy.num_bytes = message.num_bytes;
  copy.buf.reset(new uint8_t[message.num_bytes]);
  copy.message_start = copy.buf.get() + (message.message_start - message.buf.get());
  std::memcpy(copy.buf.get(), message.buf.get(), message.num_bytes);
  return copy;
}

}  // namespace pi_os_transport
