#pragma once

#include "preload/hooks.h"

namespace pi_os_transport
{

/// Puts the library's part of publishing in front of roscpp's. Once, before any of them is called.
void attachTransmitHooks(PiOsShim* shim);

}  // namespace pi_os_transport
