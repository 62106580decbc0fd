#pragma once

#include "preload/hooks.h"

namespace pi_os_transport
{

/// Puts the library's part of waiting for callbacks in front of roscpp's. Once, before any of them is called.
void attachQueueHooks(PiOsShim* shim);

}  // namespace pi_os_transport
