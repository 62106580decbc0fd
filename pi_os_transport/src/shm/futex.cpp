#include "shm/futex.h"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <climits>
#include <ctime>

namespace pi_os_transport
{

static_assert(sizeof(std::atomic<uint32_t>) == sizeof(uint32_t), "the kernel reads the word");

void futexWait(std::atomic<uint32_t>* word, uint32_t expected, std::chrono::nanoseconds longest)
{
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(longest);
  const timespec time{static_cast<time_t>(seconds.count()), static_cast<long>((longest - seconds).count())};
  syscall(SYS_futex, word, FUTEX_WAIT, expected, longest.count() < 0 ? nullptr : &time, nullptr, 0);
}

void futexWake(std::atomic<uint32_t>* word)
{
  syscall(SYS_futex, word, FUTEX_WAKE, INT_MAX, nullptr, nullptr, 0);
}

}  // namespace pi_os_transport
