#pragma once

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Makes an event that a thread can wait for with poll (an eventfd, not blocking). Empty on failure, with errno set.
FileDescriptor makeEvent();
/// Wakes the thread that waits for `event`. Any thread. @return false on failure
bool signalEvent(int event);
/// Resets `event`. @return true if it had been signalled
bool clearEvent(int event);

}  // namespace pi_os_transport
