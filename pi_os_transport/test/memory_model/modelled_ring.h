#pragma once

// The ring's own source, compiled against the model's atomics: inside pi_os_transport `std::atomic` finds the one below
// before that of the standard library, and everything else of std as ever.

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "weak_memory.h"

namespace pi_os_transport::std
{
using namespace ::std;

template <typename T>
using atomic = ::weak_memory::Atomic<T>;

inline void atomic_thread_fence(::std::memory_order order, const char* function = __builtin_FUNCTION(),
                                int line = __builtin_LINE())
{
  ::weak_memory::fence(order, function, line);
}
}  // namespace pi_os_transport::std

#include "../../src/descriptor_ring.cpp"  // NOLINT: its functions have to be those of the model
