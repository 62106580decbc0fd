#include "units/thread_class.h"

#include <sched.h>

#include <cstring>
#include <thread>

namespace pi_runtime
{

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

}  // namespace pi_runtime
