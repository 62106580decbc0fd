#pragma once

#include <string>

namespace pi_os_transport
{

/// Sets the scheduling weight of this process: its nice value, and that of its autogroup if the process leads its
/// session. With autogroups, a nice value alone counts only inside a session; roslaunch starts each node in its own.
/// @param nice  -20 (most) .. 19; 0 leaves the process as it was started
/// @return why this was refused; empty if it was not
std::string setNice(int nice);

}  // namespace pi_os_transport
