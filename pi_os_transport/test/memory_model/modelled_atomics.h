#pragma once

// To be included before a source that is to run in the model: inside pi_os_transport `std::atomic`, `std::mutex` and
// fences are found below before those of the standard library, and everything else of std as ever.

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
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
using mutex = ::weak_memory::Mutex;

inline void atomic_thread_fence(::std::memory_order order, const char* function = __builtin_FUNCTION(),
                                int line = __builtin_LINE())
{
  ::weak_memory::fence(order, function, line);
}
}  // namespace pi_os_transport::std
