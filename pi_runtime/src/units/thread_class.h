#pragma once

#include <pthread.h>

#include <mutex>
#include <string>

namespace pi_runtime
{

/// A mutex whose holder runs with the priority of those that wait for it. Without that, a real-time thread that waits
/// for a thread of the ordinary class waits for all real-time work that is in front of that.
class InheritingMutex : public std::mutex
{
public:
  InheritingMutex()
  {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_destroy(native_handle());
    pthread_mutex_init(native_handle(), &attributes);
    pthread_mutexattr_destroy(&attributes);
  }
};

/// Gives the thread a SCHED_FIFO priority; 0: the ordinary class. Threads that it starts are of the ordinary class.
/// @return 0, or the error number.
int setRealTimePriority(pthread_t thread, int priority);

/// Whether this process may have that priority. @param why  set to the kernel's word if not.
bool mayBeRealTime(int priority, std::string* why);

}  // namespace pi_runtime
