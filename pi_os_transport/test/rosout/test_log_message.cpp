#include "rosout/log_message.h"

#include <gtest/gtest.h>
#include <rosgraph_msgs/Log.h>

#include <string>

namespace pi_os_transport
{
namespace
{

rosgraph_msgs::Log message()
{
  rosgraph_msgs::Log log;
  log.header.seq = 7;
  log.header.stamp = ros::Time(12, 34);
  log.header.frame_id = "frame";
  log.level = rosgraph_msgs::Log::WARN;
  log.name = "/node";
  log.msg = "two\nlines";
  log.file = "file.cpp";
  log.function = "f";
  log.line = 56;
  log.topics = {"/a", "/b"};
  return log;
}

std::string serialised(const rosgraph_msgs::Log& log)
{
  std::string bytes(ros::serialization::serializationLength(log), '\0');
  ros::serialization::OStream stream(reinterpret_cast<uint8_t*>(bytes.data()), static_cast<uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, log);
  return bytes;
}

TEST(LogMessage, ReadsWhatRosSerialises)
{
  const std::string bytes = serialised(message());
  const std::optional<LogMessage> read = readLogMessage(bytes);
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(12U, read->stamp_s);
  EXPECT_EQ(34U, read->stamp_ns);
  EXPECT_EQ(rosgraph_msgs::Log::WARN, read->level);
  EXPECT_EQ("/node", read->node);
  EXPECT_EQ((std::vector<std::string_view>{"/a", "/b"}), read->topics);
}

TEST(LogMessage, RefusesEveryTruncation)
{
  const std::string bytes = serialised(message());
  for (size_t size = 0; size < bytes.size(); ++size)
  {
    EXPECT_FALSE(readLogMessage(std::string_view(bytes).substr(0, size)).has_value()) << size;
  }
}

TEST(LogMessage, IsWrittenAsByTheRosoutNode)
{
  rosgraph_msgs::Log log = message();
  const std::string bytes = serialised(log);
  EXPECT_EQ("12.000000034 WARN /node [file.cpp:56(f)] [topics: /a, /b] two\nlines\n",
            formatLogMessage(*readLogMessage(bytes), true));
  EXPECT_EQ("12.000000034 WARN /node [file.cpp:56(f)] two\nlines\n", formatLogMessage(*readLogMessage(bytes), false));
  log.level = 3;
  log.topics.clear();
  const std::string odd = serialised(log);
  EXPECT_EQ("12.000000034 3 /node [file.cpp:56(f)] [topics: ] two\nlines\n",
            formatLogMessage(*readLogMessage(odd), true));
}

TEST(LogType, IsThatOfTheMessage)
{
  EXPECT_STREQ("rosgraph_msgs/Log", LogType::name());
  EXPECT_EQ(32U, std::string(LogType::md5sum()).size());
  EXPECT_NE(std::string::npos, std::string(LogType::definition()).find("string[] topics"));
}

}  // namespace
}  // namespace pi_os_transport
