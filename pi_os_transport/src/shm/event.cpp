#include "shm/event.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>

namespace pi_os_transport
{

FileDescriptor makeEvent()
{
  return FileDescriptor(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
}

bool signalEvent(int event)
{
  const uint64_t one = 1;
  return TEMP_FAILURE_RETRY(write(event, &one, sizeof(one))) == static_cast<ssize_t>(sizeof(one));
}

bool clearEvent(int event)
{
  uint64_t count;
  return TEMP_FAILURE_RETRY(read(event, &count, sizeof(count))) == static_cast<ssize_t>(sizeof(count));
}

}  // namespace pi_os_transport
