#pragma once

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// The signals that end a program (SIGINT, SIGTERM) as something to wait for, a signalfd. They are blocked from then on
/// and SIGPIPE is ignored; to be called before the first thread is started. Invalid, with errno set, if there is no
/// descriptor left.
FileDescriptor endSignals();

}  // namespace pi_os_transport
