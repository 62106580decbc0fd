#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace pi_os_transport
{

/// Description of rosgraph_msgs/Log in TCPROS headers, the type of /rosout and /rosout_agg.
struct LogType
{
  static const char* name();
  static const char* md5sum();
  static const char* definition();
};

/// A rosgraph_msgs/Log. The texts point into the serialised bytes.
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
  std::vector<std::string_view> topics;  ///< published by the node
};

/// @param bytes  serialised by ROS. @return nothing if they are truncated
std::optional<LogMessage> readLogMessage(std::string_view bytes);

/// The text in the log file of the rosout node.
std::string formatLogMessage(const LogMessage& message, bool with_topics);

}  // namespace pi_os_transport
