#pragma once

#include <ros/serialized_message.h>

#include <cstdint>

#include "shm/ring_sender.h"

namespace pi_os_transport
{

/// Buffers of the pool that may wait in one queue before further ones are copied to the heap: a stuck peer must not
/// exhaust the pool.
constexpr size_t MAX_POOLED_WAITING = 2;

/// A buffer of the pool with the content of `message`, referenced once more: its own if it lies there, or a copy.
/// @return null if the pool is full, or `message` has no length prefix.
const uint8_t* poolBuffer(const ros::SerializedMessage& message);

/// A message taken back from a ring; its buffer is given back to the pool with its last user.
ros::SerializedMessage pooledMessage(const RingSender::Message& message);

/// `message` to be queued behind `waiting` others: beyond MAX_POOLED_WAITING on the heap.
ros::SerializedMessage messageToQueue(const ros::SerializedMessage& message, size_t waiting);

}  // namespace pi_os_transport
