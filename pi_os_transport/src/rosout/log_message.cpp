#include "rosout/log_message.h"

#include <array>
#include <cstdio>

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{
namespace
{

class Fields
{
public:
  explicit Fields(std::string_view bytes) : bytes_(bytes) {}

  template <typename Number>
  Number number()
  {
    const std::string_view part = take(sizeof(Number));
    return part.empty() ? 0 : loadLittleEndian<Number>(reinterpret_cast<const uint8_t*>(part.data()));
  }
  std::string_view text() { return take(number<uint32_t>()); }
  bool isWhole() const { return is_whole_; }

private:
  std::string_view take(size_t size)
  {
    is_whole_ = is_whole_ && size <= bytes_.size();
    if (!is_whole_)
    {
      return {};
    }
    const std::string_view part = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return part;
  }

  std::string_view bytes_;
  bool is_whole_ = true;
};

std::string levelName(uint8_t level)
{
  switch (level)
  {
    case 1:
      return "DEBUG";
    case 2:
      return "INFO";
    case 4:
      return "WARN";
    case 8:
      return "ERROR";
    case 16:
      return "FATAL";
    default:
      return std::to_string(level);
  }
}

}  // namespace

std::optional<LogMessage> readLogMessage(std::string_view bytes)
{
  Fields fields(bytes);
  LogMessage message;
  fields.number<uint32_t>();  // sequence number
  message.stamp_s = fields.number<uint32_t>();
  message.stamp_ns = fields.number<uint32_t>();
  fields.text();  // frame
  message.level = fields.number<uint8_t>();
  message.node = fields.text();
  message.text = fields.text();
  message.file = fields.text();
  message.function = fields.text();
  message.line = fields.number<uint32_t>();
  for (uint32_t count = fields.number<uint32_t>(); count > 0 && fields.isWhole(); --count)
  {
    message.topics.push_back(fields.text());
  }
  if (!fields.isWhole())
  {
    return std::nullopt;
  }
  return message;
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
