#pragma once

#include "preload/zero_copy_api.h"

namespace pi_os_transport::zero_copy
{

/// The shared memory of this process; null if it has none. Any thread.
const PiOsZeroCopyApi* transport();

}  // namespace pi_os_transport::zero_copy
