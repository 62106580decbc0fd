#pragma once

namespace pi_os_transport
{

/// Description of rosgraph_msgs/Log in TCPROS headers, the type of /rosout and /rosout_agg.
struct LogType
{
  static const char* name();
  static const char* md5sum();
  static const char* definition();
};

}  // namespace pi_os_transport
