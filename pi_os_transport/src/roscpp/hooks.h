#pragma once

#include "preload/hooks.h"

namespace pi_os_transport
{

// Each replaces the functions of roscpp for one field. Call once, before roscpp uses any of them.
void attachTransmitHooks(PiOsShim* shim);  ///< publishing
void attachReceiveHooks(PiOsShim* shim);   ///< subscribing
void attachLatchHooks(PiOsShim* shim);
void attachDeserializeHooks(PiOsShim* shim);
void attachQueueHooks(PiOsShim* shim);     ///< waiting for callbacks
void attachServiceHooks(PiOsShim* shim);

}  // namespace pi_os_transport
