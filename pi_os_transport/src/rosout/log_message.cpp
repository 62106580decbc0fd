#include "rosout/log_message.h"

#include <rosgraph_msgs/Log.h>

#include <array>
#include <cstdio>
#include <map>
#include <utility>

#include "wire/payload.h"

namespace pi_os_transport
{
namespace
{

/// A text as ROS serialises it: its length, then its bytes.
std::string_view readText(PayloadReader* in)
{
  const uint32_t length = in->getU32();
  const auto* const text = reinterpret_cast<const char*>(in->rest());
  in->skip(length);
  return in->ok() ? std::string_view(text, length) : std::string_view();
}

std::string levelName(uint8_t level)
{
  static const std::map<uint8_t, const char*> NAMES{
      {1, "DEBUG"}, {2, "INFO"}, {4, "WARN"}, {8, "ERROR"}, {16, "FATAL"}};
  const auto found = NAMES.find(level);
  return found != NAMES.end() ? found->second : std::to_string(level);
}

}  // namespace

const char* LogType::name()
{
  return ros::message_traits::DataType<rosgraph_msgs::Log>::value();
}

const char* LogType::md5sum()
{
  return ros::message_traits::MD5Sum<rosgraph_msgs::Log>::value();
}

const char* LogType::definition()
{
  return ros::message_traits::Definition<rosgraph_msgs::Log>::value();
}

std::optional<LogMessage> readLogMessage(std::string_view bytes)
{
  PayloadReader in(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
  LogMessage message;
  in.getU32();  // sequence number
  message.stamp_s = in.getU32();
  message.stamp_ns = in.getU32();
  readText(&in);  // frame
  message.level = in.restLength() != 0 ? *in.rest() : uint8_t{0};
  in.skip(sizeof(message.level));
  for (std::string_view* const text : {&message.node, &message.text, &message.file, &message.function})
  {
    *text = readText(&in);
  }
  message.line = in.getU32();
  for (uint32_t count = in.getU32(); count > 0 && in.ok(); --count)
  {
    message.topics.push_back(readText(&in));
  }
  return in.ok() ? std::optional<LogMessage>(std::move(message)) : std::nullopt;
}

std::string formatLogMessage(const LogMessage& message, bool with_topics)
{
  std::array<char, 32> stamp;
  std::snprintf(stamp.data(), stamp.size(), "%u.%09u ", message.stamp_s, message.stamp_ns);
  std::string line = stamp.data() + levelName(message.level) + " ";
  line.append(message.node).append(" [").append(message.file).append(":").append(std::to_string(message.line));
  line.append("(").append(message.function).append(")] ");
  if (with_topics)
  {
    line += "[topics: ";
    for (size_t index = 0; index < message.topics.size(); ++index)
    {
      line.append(index == 0 ? "" : ", ").append(message.topics[index]);
    }
    line += "] ";
  }
  return line.append(message.text).append("\n");
}

}  // namespace pi_os_transport
