#include "zero_copy/transport.h"

#include <dlfcn.h>

namespace pi_os_transport::zero_copy
{

const PiOsZeroCopyApi* transport()
{
  static const PiOsZeroCopyApi* const api = []() -> const PiOsZeroCopyApi*
  {
    const auto find =
        reinterpret_cast<decltype(&pi_os_transport_zero_copy)>(dlsym(RTLD_DEFAULT, "pi_os_transport_zero_copy"));
    return find != nullptr ? find(PI_OS_ZERO_COPY_VERSION) : nullptr;
  }();
  return api;
}

}  // namespace pi_os_transport::zero_copy
