#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace pi_os_transport
{

/// Sleeps while `word`, in memory that processes may share, is `expected`. May return early for no reason.
/// @param longest  negative: without limit.
void futexWait(std::atomic<uint32_t>* word, uint32_t expected, std::chrono::nanoseconds longest);
/// Wakes all threads that sleep on `word`.
void futexWake(std::atomic<uint32_t>* word);

}  // namespace pi_os_transport
