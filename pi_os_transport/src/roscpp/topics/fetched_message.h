#pragma once

#include <boost/shared_array.hpp>

#include <atomic>
#include <cstdint>
#include <memory>

#include "shm/ring_receiver.h"

namespace pi_os_transport
{

/// Gets a message taken from `ring`: leased in place, or beyond the lease budget as a copy, which `*copied` counts. The
/// caller serialises this with other calls of `ring`.
/// @param held  counts messages that zero-copy subscribers hold; null: the message cannot be held.
/// @return null if the memory cannot be read.
boost::shared_array<uint8_t> fetchMessage(const std::shared_ptr<RingReceiver>& ring,
                                          const RingReceiver::Message& message, uint64_t* copied,
                                          const std::shared_ptr<std::atomic<uint64_t>>& held = nullptr);

}  // namespace pi_os_transport
