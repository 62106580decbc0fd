#pragma once

#include <ros/serialized_message.h>

#include <cstdint>

#include "shm/ring_sender.h"

namespace pi_os_transport
{

/// Most buffers of the pool that wait in one queue. Further messages are copied to the heap, so that a stuck peer
/// cannot exhaust the pool.
constexpr size_t MAX_POOLED_WAITING = 2;

/// A pool buffer with the content of `message` and one more reference: its own buffer if it is in the pool, else a
/// copy.
/// @return null if the pool is full, or `message` has no length prefix.
const uint8_t* poolBuffer(const ros::SerializedMessage& message);

/// `message` for a queue with `waiting` others; copied to the heap beyond MAX_POOLED_WAITING.
ros::SerializedMessage messageToQueue(const ros::SerializedMessage& message, size_t waiting);

}  // namespace pi_os_transport
