#pragma once

#include <string>

namespace pi_node
{

/// Prefers the calling thread, and those that it starts, within the ordinary class as far as the kernel allows: nice
/// -10, and the same for the session's autogroup if the session is this process's own. Not in simulated time: there, what
/// renders and records would starve, and nothing is late.
/// @return what it has now, as "nice -10".
std::string preferThread();

}  // namespace pi_node
