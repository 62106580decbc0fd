// Preloaded to a process: every fiftieth lock or unlock of a mutex takes a while, as if the thread had lost its core
// there. What goes wrong once in thousands of times otherwise goes wrong soon.

#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>

#include <cstdint>

namespace
{

constexpr uint32_t ONE_IN = 50;
constexpr uint32_t LONGEST_US = 150;

thread_local uint32_t state = 0;

void pauseNowAndThen()
{
  if (state == 0)
  {
    state = static_cast<uint32_t>(reinterpret_cast<uintptr_t>(&state) >> 6 | 1);
  }
  state = state * 1664525 + 1013904223;
  if ((state >> 16) % ONE_IN == 0)
  {
    usleep((state >> 8) % LONGEST_US);
  }
}

int call(const char* name, pthread_mutex_t* mutex)
{
  return reinterpret_cast<int (*)(pthread_mutex_t*)>(dlsym(RTLD_NEXT, name))(mutex);
}

}  // namespace

extern "C" int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept
{
  pauseNowAndThen();
  return call("pthread_mutex_lock", mutex);
}

extern "C" int pthread_mutex_unlock(pthread_mutex_t* mutex) noexcept
{
  const int result = call("pthread_mutex_unlock", mutex);
  pauseNowAndThen();
  return result;
}
