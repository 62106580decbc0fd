#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace pi_os_transport
{

/// What rosgraph_msgs/Log says. The texts lie in the bytes it was read from.
struct LogMessage
{
  uint32_t stamp_s = 0;
  uint32_t stamp_ns = 0;  ///< within the second
  uint8_t level = 0;      ///< 1 debug, 2 info, 4 warning, 8 error, 16 fatal
  std::string_view node;
  std::string_view text;
  std::string_view file;
  std::string_view function;
  uint32_t line = 0;
  std::vector<std::string_view> topics;  ///< that the node publishes
};

/// @param bytes  serialised as ROS does. @return nothing if they are too short for what they announce.
std::optional<LogMessage> readLogMessage(std::string_view bytes);

/// One line, or more if the text has more, as the rosout node writes it to its file.
std::string formatLogMessage(const LogMessage& message, bool with_topics);

}  // namespace pi_os_transport
