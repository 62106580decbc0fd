#include <pi_node/scheduling.h>

#include <pi_node/vehicle_clock.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>

namespace pi_node
{
namespace
{

constexpr int PREFERRED_NICE = -10;

}  // namespace

std::string preferThread()
{
  const auto thread = static_cast<id_t>(syscall(SYS_gettid));
  if (!isTimeSimulated() && setpriority(PRIO_PROCESS, thread, PREFERRED_NICE) == 0 && getsid(0) == getpid())
  {
    // Else the kernel weighs the session as a whole against others, whatever its threads' nice values.
    std::ofstream("/proc/self/autogroup") << PREFERRED_NICE;
  }
  errno = 0;
  const int nice = getpriority(PRIO_PROCESS, thread);
  return errno != 0 ? "" : "nice " + std::to_string(nice);
}

}  // namespace pi_node
