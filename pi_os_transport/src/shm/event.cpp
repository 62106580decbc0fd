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
  ssize_t written;
  do
  {
    written = write(event, &one, sizeof(one));
  } while (written < 0 && errno == EINTR);
  return written == static_cast<ssize_t>(sizeof(one));
}

bool clearEvent(int event)
{
  uint64_t count;
  ssize_t received;
  do
  {
    received = read(event, &count, sizeof(count));
  } while (received < 0 && errno == EINTR);
  return received == static_cast<ssize_t>(sizeof(count));
}

}  // namespace pi_os_transport
