#include "units/thread_class.h"

#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <thread>

namespace pi_runtime
{
namespace
{

constexpr int PREFERRED_NICE = -5;

}  // namespace

int setRealTimePriority(pthread_t thread, int priority)
{
  sched_param parameter{};
  parameter.sched_priority = priority;
  return pthread_setschedparam(thread, (priority > 0 ? SCHED_FIFO : SCHED_OTHER) | SCHED_RESET_ON_FORK, &parameter);
}

bool mayBeRealTime(int priority, std::string* why)
{
  int code = 0;
  std::thread([&] { code = setRealTimePriority(pthread_self(), priority); }).join();
  if (code != 0)
  {
    *why = std::strerror(code);
  }
  return code == 0;
}

std::string preferThread()
{
  const auto thread = static_cast<id_t>(syscall(SYS_gettid));
  if (setpriority(PRIO_PROCESS, thread, PREFERRED_NICE) == 0 && getsid(0) == getpid())
  {
    // Else the kernel weighs the session as a whole against others, whatever its threads' nice values.
    std::ofstream("/proc/self/autogroup") << PREFERRED_NICE;
  }
  errno = 0;
  const int nice = getpriority(PRIO_PROCESS, thread);
  return errno != 0 ? "" : "nice " + std::to_string(nice);
}

}  // namespace pi_runtime
