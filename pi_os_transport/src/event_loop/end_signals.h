#pragma once

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Makes a signalfd for SIGINT and SIGTERM, blocks both, and ignores SIGPIPE. Call it before the first thread starts.
/// Empty on failure, with errno set.
FileDescriptor endSignals();

}  // namespace pi_os_transport
