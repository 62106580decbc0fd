#include "bridge/scheduling.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

std::string setNice(int nice)
{
  if (nice == 0)
  {
    return {};
  }
  const auto refused = [nice]()
  {
    return "nice " + std::to_string(nice) + " is refused (" + std::generic_category().message(errno) +
           "): allow it in limits.conf or by LimitNICE=, or set nice to 0";
  };
  if (setpriority(PRIO_PROCESS, 0, nice) != 0)
  {
    return refused();
  }
  const FileDescriptor autogroup(getsid(0) == getpid() ? open("/proc/self/autogroup", O_WRONLY | O_CLOEXEC) : -1);
  const std::string text = std::to_string(nice);
  if (autogroup && write(autogroup.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()))
  {
    return refused();
  }
  return {};
}

}  // namespace pi_os_transport
