// Preloaded: lets the campaign move the wall clock of a node, and of nobody else on the machine. The file named by
// PI_OS_TEST_CLOCK holds the offset in nanoseconds (int64); it may change at any time.

#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdlib>

namespace
{

constexpr int64_t NS_PER_S = 1000000000;
constexpr time_t WALL_CLOCK_FROM_S = 100000000;  // no monotonic clock shows three years

int64_t offsetNs()
{
  static const std::atomic<int64_t>* const offset = []() -> const std::atomic<int64_t>*
  {
    const char* path = std::getenv("PI_OS_TEST_CLOCK");
    const int fd = path != nullptr ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void* memory = fd >= 0 ? mmap(nullptr, sizeof(int64_t), PROT_READ, MAP_SHARED, fd, 0) : MAP_FAILED;
    close(fd);
    return memory != MAP_FAILED ? static_cast<const std::atomic<int64_t>*>(memory) : nullptr;
  }();
  return offset != nullptr ? offset->load(std::memory_order_relaxed) : 0;
}

timespec shifted(const timespec& time, int64_t by_ns)
{
  const int64_t total_ns = time.tv_sec * NS_PER_S + time.tv_nsec + by_ns;
  return timespec{total_ns / NS_PER_S, total_ns % NS_PER_S};
}

template <typename Function>
Function next(const char* name)
{
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

/// What the kernel has to wait for when a node waits for `time` of its moved clock.
timespec real(const timespec* time)
{
  return time->tv_sec >= WALL_CLOCK_FROM_S ? shifted(*time, -offsetNs()) : *time;
}

}  // namespace

extern "C"
{
  int clock_gettime(clockid_t clock, timespec* now) noexcept
  {
    static const auto original = next<int (*)(clockid_t, timespec*)>("clock_gettime");
    const int result = original(clock, now);
    if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    {
      *now = shifted(*now, offsetNs());
    }
    return result;
  }

  int gettimeofday(timeval* __restrict now, void* __restrict) noexcept
  {
    timespec time;
    const int result = clock_gettime(CLOCK_REALTIME, &time);
    *now = timeval{time.tv_sec, static_cast<suseconds_t>(time.tv_nsec / 1000)};
    return result;
  }

  time_t time(time_t* seconds) noexcept
  {
    timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (seconds != nullptr)
    {
      *seconds = now.tv_sec;
    }
    return now.tv_sec;
  }

  int pthread_cond_timedwait(pthread_cond_t* __restrict condition, pthread_mutex_t* __restrict mutex,
                             const timespec* __restrict until)
  {
    static const auto original =
        next<int (*)(pthread_cond_t*, pthread_mutex_t*, const timespec*)>("pthread_cond_timedwait");
    const timespec time = real(until);
    return original(condition, mutex, &time);
  }

  int pthread_cond_clockwait(pthread_cond_t* __restrict condition, pthread_mutex_t* __restrict mutex, clockid_t clock,
                             const timespec* __restrict until)
  {
    static const auto original =
        next<int (*)(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*)>("pthread_cond_clockwait");
    const timespec time = clock == CLOCK_REALTIME ? real(until) : *until;
    return original(condition, mutex, clock, &time);
  }
}
