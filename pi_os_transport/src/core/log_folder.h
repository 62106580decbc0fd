#pragma once

#include <string>

namespace pi_os_transport
{

/// @return a unique identifier of this run, in the form of a UUID
/// @throws std::runtime_error
std::string newRunId();

/// Makes the log folder of a run, where all ROS tools look for it, and the link "latest" to it.
/// @return $ROS_LOG_DIR/<run_id>, else $ROS_HOME/log/<run_id>, else ~/.ros/log/<run_id>.
/// @throws std::runtime_error naming the folder and the remedy
std::string makeLogFolder(const std::string& run_id);

}  // namespace pi_os_transport
