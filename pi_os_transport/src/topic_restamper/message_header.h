#pragma once

#include <sstream>
#include <string>

namespace pi_os_transport
{

/// True if the first field of a message definition (from the connection header) is a std_msgs/Header.
inline bool beginsWithHeader(const std::string& message_definition)
{
  std::istringstream lines(message_definition);
  for (std::string line; std::getline(lines, line);)
  {
    const std::string field = line.substr(0, line.find('#'));
    std::string type;
    std::istringstream(field) >> type;
    if (type.rfind("===", 0) == 0)
    {
      return false;  // definitions of parts begin here: the message has no field
    }
    if (!type.empty() && field.find('=') == std::string::npos)  // a constant is not part of the message
    {
      return type == "Header" || type == "std_msgs/Header" || type == "roslib/Header";
    }
  }
  return false;
}

}  // namespace pi_os_transport
